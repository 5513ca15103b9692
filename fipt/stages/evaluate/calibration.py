"""Errors by confidence: those that the material maps predict, beside those that the truth finds."""

from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from fipt.stages.evaluate.means import Mean, psnr

CONFIDENCE_CLASSES = 5
"""Classes of equal width into which confidence is divided."""
PREDICTED = {"kd_error": "kd", "roughness_error": "roughness", "metallic_error": "metallic"}
"""Layer of predicted errors -> the layer whose errors they are."""

_FACTOR = 1.5
"""Predicted and found errors that differ by less agree."""
_FLOOR = 0.01
"""Smaller errors count as this: neither eye nor truth map tells them apart."""
_FEWEST = 0.01
"""Share of the pixels that a class must hold to be judged."""


class ConfidenceFigures:
    """Figures by class of confidence, gathered with `add`."""

    def __init__(self) -> None:
        self._classes: list[dict[str, Mean]] = []

    def add(
        self, confidence: np.ndarray, errors: Mapping[str, np.ndarray], predicted: Mapping[str, np.ndarray]
    ) -> None:
        """Count errors of pixels (N, ...) by their confidence (N,), and what layers predicted of them (N,)."""
        self._classes = self._classes or [defaultdict(Mean) for _ in range(CONFIDENCE_CLASSES)]
        classes = np.minimum(confidence * CONFIDENCE_CLASSES, CONFIDENCE_CLASSES - 1).astype(int)
        for number, means in enumerate(self._classes):
            own = classes == number
            means["pixels"].add(own)
            for name, error in errors.items():
                means[name].add(error[own])
            for name, values in predicted.items():
                means[name].add(values[own].astype(np.float64) ** (2 if name == "kd_error" else 1))

    def figures(self) -> dict[str, Any]:
        """``by_confidence`` and ``calibration`` of metrics.json; None where no map holds confidence."""
        rows = [self._row(number, means) for number, means in enumerate(self._classes)]
        return {"by_confidence": rows or None, "calibration": self._calibration()}

    @staticmethod
    def _row(number: int, means: Mapping[str, Mean]) -> dict[str, Any]:
        row = {
            "from": number / CONFIDENCE_CLASSES,
            "to": (number + 1) / CONFIDENCE_CLASSES,
            "share": means["pixels"].value,
            "kd_psnr": psnr(means["kd"].value),
            "reflectance_psnr": psnr(means["reflectance"].value),
            "roughness_l1": means["roughness"].value,
            "metallic_l1": means["metallic"].value,
        }
        if any(name in means for name in PREDICTED):
            row |= {
                "predicted_kd_psnr": psnr(means["kd_error"].value),
                "predicted_roughness_l1": means["roughness_error"].value,
                "predicted_metallic_l1": means["metallic_error"].value,
            }
        return row

    def _calibration(self) -> dict[str, Any] | None:
        judged = [means for means in self._classes if (means["pixels"].value or 0) >= _FEWEST]
        if not any(name in means for means in judged for name in PREDICTED):
            return None
        found = [means["kd"].value for means in judged if means["kd"].value is not None]
        ordered = all(worse >= better for worse, better in pairwise(found))
        agreed = {name: _agreed(judged, layer, name) for layer, name in PREDICTED.items()}
        return {"ordered": ordered if found else None, **agreed}


def _agreed(classes: list[dict[str, Mean]], layer: str, name: str) -> float | None:
    """Share of the pixels of classes whose predicted and found errors agree; None without both."""
    pixels = agreed = 0.0
    for means in classes:
        pair = [value for key in (layer, name) if (value := means[key].value) is not None]
        if len(pair) == 2:
            errors = [max(float(np.sqrt(value)) if name == "kd" else value, _FLOOR) for value in pair]
            share = means["pixels"].total
            pixels += share
            agreed += share * (max(errors) <= _FACTOR * min(errors))
    return agreed / pixels if pixels else None
