"""Figures of a result: materials, emission and images against ground truth and photographs.

Everything here is a pure function of arrays. Views are streamed, so that a scene never has to fit
in memory. A figure for which no pixel qualifies, or for which there is no truth, is None; NaN never
leaves this module, because it is refused where it would enter.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.formats.images import srgb_encode
from fipt.stages.evaluate.calibration import PREDICTED, ConfidenceFigures
from fipt.stages.evaluate.means import Mean, psnr

Layers = Mapping[str, np.ndarray]
"""Layer name -> (H, W, 3) or (H, W) float32, as `fipt.scene.dataset.read_layers` gives them."""

PUBLISHED_ROUGHNESS = 0.2
"""The published tables raise true and estimated roughness to this before comparing them."""

_COMPARED = 100_000
"""Pixels of a view, or up to twice as many, that tell the exposure of photographs."""
_HUBER = 0.1
"""Differences of log luminance up to this count as squares."""

DEFINITIONS: dict[str, dict[str, str]] = {
    "kd_psnr": {
        "label": "Diffuse kd",
        "unit": "dB",
        "better": "higher",
        "text": "PSNR of kd on linear values, peak 1, over pixels whose centre hits the mesh and, in truth, surface "
        "that does not emit, and that the image's mask keeps; squared error pooled over the views of the split.",
    },
    "reflectance_psnr": {
        "label": "Reflectance a'",
        "unit": "dB",
        "better": "higher",
        "text": "PSNR of the directional albedo a' (diffuse and specular together) on linear "
        "values, peak 1, over the same pixels, pooled in the same way.",
    },
    "base_color_psnr": {
        "label": "Base colour",
        "unit": "dB",
        "better": "higher",
        "text": "PSNR of the base colour on linear values, peak 1, over the same pixels, pooled in the same way.",
    },
    "roughness_l1": {
        "label": "Roughness",
        "unit": "L1",
        "better": "lower",
        "text": "Mean absolute difference of perceptual roughness over the same pixels.",
    },
    "metallic_l1": {
        "label": "Metallic",
        "unit": "L1",
        "better": "lower",
        "text": "Mean absolute difference of metallic over the same pixels.",
    },
    "emission_iou": {
        "label": "Emission",
        "unit": "IoU",
        "better": "higher",
        "text": "Pixels that emit in truth and in the estimate, over pixels that emit in either; "
        "valid pixels whose centre hits the mesh and true surface, counts summed over the views.",
    },
    "log_radiance_error": {
        "label": "Emitted radiance",
        "unit": "|Δ ln|",
        "better": "lower",
        "text": "Mean absolute difference of the natural logarithm of the emitted radiance, over "
        "pixels and channels that emit in both.",
    },
    "by_confidence": {
        "label": "Error by confidence",
        "unit": "",
        "better": "",
        "text": "The same pixels as for kd, in five classes by the confidence of the material maps: share of the "
        "pixels, PSNR of kd and a', mean absolute difference of roughness and metallic; beside them (predicted_...) "
        "what the maps' layers of errors say of the same pixels. Where confidence tells the truth, errors fall from "
        "class to class.",
    },
    "calibration": {
        "label": "Predicted against found errors",
        "unit": "",
        "better": "",
        "text": "ordered: the found error of kd falls from class to class of confidence. kd, roughness, metallic: the "
        "share of pixels in classes whose predicted error is within a factor of 1.5 of the found one (of kd root mean "
        "squares, of the others means; errors below 0.01 count as 0.01). Classes with less than 1 % of the pixels are "
        "left out.",
    },
    "render_psnr": {
        "label": "Re-rendering",
        "unit": "dB",
        "better": "higher",
        "text": "PSNR of the re-rendered view against its image, both clipped to [0, 1] and sRGB "
        "encoded, over all valid pixels that are not clipped; mean over the views of the split.",
    },
    "relight_psnr": {
        "label": "Relighting",
        "unit": "dB",
        "better": "higher",
        "text": "PSNR of the relit view against the truth under the same light, both clipped to "
        "[0, 1] and sRGB encoded; mean over views. Against the truth the exposure is never fitted; photographs of "
        "unknown exposure are first multiplied by one robustly fitted factor for the setup (exposure).",
    },
    "published": {
        "label": "As published tables count",
        "unit": "",
        "better": "",
        "text": "Values clipped to [0, 1] and cut to 8 bits; emitters set to 0 in both; kd set to "
        "0 wherever the true roughness is below 1; roughness raised to 0.2; PSNR of every whole "
        "image, then the mean over the images where a pixel qualifies (for kd, one that is not "
        "black). Emission: IoU, and log L2 = mean squared difference of ln(1 + radiance), of every "
        "image with a true emitter, then the mean.",
    },
}
"""What each figure means, in which unit; written into metrics.json for whoever reads it."""


def emits(layers: Layers) -> np.ndarray:
    """Return (H, W) bool, the pixels that emit: by ``emission_mask`` or by radiance."""
    if "emission_mask" in layers:
        return layers["emission_mask"] > 0.5
    return np.any(layers["emission"] > 0, axis=-1)


def _surface(truth: Layers) -> np.ndarray | bool:
    """(H, W) bool, the pixels that show surface in truth: all layers, a roughness too, are 0 where they show none."""
    if "roughness" not in truth:
        return True
    return np.any([np.any(np.atleast_3d(layer) != 0, axis=-1) for layer in truth.values()], axis=0)


def finite(layers: Layers, where: str) -> Layers:
    """Return ``layers`` if every value is finite.

    Raises
    ------
    FiptError
        If a layer holds NaN or infinity; ``where`` names the file.
    """
    for name, values in layers.items():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise FiptError(
                f"{where} must hold finite values; {bad} of layer {name} are NaN or infinite",
                "run the stage that writes it again, or repair the file",
            )
    return layers


@dataclass
class MaterialFigures:
    """Figures of material maps against truth, gathered view by view with `add`."""

    kd: Mean = field(default_factory=Mean)
    reflectance: Mean = field(default_factory=Mean)
    base_color: Mean = field(default_factory=Mean)
    roughness: Mean = field(default_factory=Mean)
    metallic: Mean = field(default_factory=Mean)
    log_radiance: Mean = field(default_factory=Mean)
    intersection: int = 0
    union: int = 0
    pixels: int = 0
    by_confidence: ConfidenceFigures = field(default_factory=ConfidenceFigures)
    published: list[dict[str, float | None]] = field(default_factory=list)

    def add(self, estimate: Layers, truth: Layers, valid: np.ndarray | bool = True) -> None:
        """Count one view.

        Parameters
        ----------
        estimate
            Layers of materials/{view}.exr, ``hit`` among them; those of another program may be fewer.
        truth
            Layers of truth/{view}.exr; layers it lacks are left out of the figures. Where all are 0 no surface is seen,
            and a mesh of photographs that closes a window there is not judged.
        valid
            (H, W) bool, pixels of the image that have weight; the others do not count.
        """
        hit = (estimate["hit"] > 0.5) & valid & _surface(truth)
        true_emission = emits(truth)
        counted = hit & ~true_emission
        self.pixels += int(counted.sum())
        errors = {}
        for name in ("kd", "reflectance", "base_color", "roughness", "metallic"):
            if name in truth and name in estimate:
                error = np.float64(estimate[name][counted]) - truth[name][counted]
                errors[name] = np.abs(error) if name in ("roughness", "metallic") else error**2
                getattr(self, name).add(errors[name])
        if "confidence" in estimate:
            predicted = {name: estimate[name][counted] for name in PREDICTED if name in estimate}
            self.by_confidence.add(estimate["confidence"][counted], errors, predicted)
        if "emission" in estimate:
            self._add_emission(estimate, truth, hit)
        if "emission" in truth:
            self.published.append(published_view(estimate, truth))

    def _add_emission(self, estimate: Layers, truth: Layers, hit: np.ndarray) -> None:
        true_emission, emission = emits(truth), emits(estimate)
        self.intersection += int((hit & true_emission & emission).sum())
        self.union += int((hit & (true_emission | emission)).sum())
        if "emission" in truth:
            both = hit & true_emission & emission
            self.log_radiance.add(log_differences(estimate["emission"][both], truth["emission"][both]))

    def figures(self) -> dict[str, Any]:
        """Return the figures under their names in metrics.json, and the pixels counted."""
        return {
            "kd_psnr": psnr(self.kd.value),
            "reflectance_psnr": psnr(self.reflectance.value),
            "base_color_psnr": psnr(self.base_color.value),
            "roughness_l1": self.roughness.value,
            "metallic_l1": self.metallic.value,
            "emission_iou": self.intersection / self.union if self.union else None,
            "log_radiance_error": self.log_radiance.value,
            **self.by_confidence.figures(),
            "published": published_mean(self.published),
            "pixels": {"materials": self.pixels, "emission_union": self.union},
        }


def log_differences(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """|ln estimate - ln truth| of the entries where both are positive; any shape in, (n,) out."""
    both = (estimate > 0) & (truth > 0)
    return np.abs(np.log(np.float64(estimate[both])) - np.log(np.float64(truth[both])))


def _cut(values: np.ndarray) -> np.ndarray:
    """Clip to [0, 1] and cut to 8 bits, as the published evaluation stores its maps."""
    return np.floor(np.clip(np.float64(values), 0.0, 1.0) * 255.0) / 255.0


def published_view(estimate: Layers, truth: Layers) -> dict[str, float | None]:
    """Figures of one view as published tables count them (see ``DEFINITIONS["published"]``).

    They are here to be compared with those tables and nothing else: zeroed pixels count as perfect.
    """
    true_emission = np.any(truth["emission"] > 0, axis=-1)
    figures: dict[str, float | None] = dict.fromkeys(
        ("kd_psnr", "reflectance_psnr", "roughness_psnr", "emission_iou", "log_l2")
    )

    def compare(name: str, qualifies: np.ndarray, floor: float = 0.0) -> float | None:
        if name not in truth or name not in estimate or not qualifies.any():
            return None
        pair = [np.maximum(_cut(layers[name]), floor) for layers in (estimate, truth)]
        return psnr(float(np.mean(((pair[0] - pair[1]).T * qualifies.T) ** 2)))

    if "roughness" in truth:
        diffuse = ~true_emission & (_cut(truth["roughness"]) == 1.0)
        # Black alone is zero, as all else is made: any method would be perfect.
        if "kd" in truth and _cut(truth["kd"])[diffuse].any():
            figures["kd_psnr"] = compare("kd", diffuse)
    figures["reflectance_psnr"] = compare("reflectance", ~true_emission)
    figures["roughness_psnr"] = compare("roughness", ~true_emission, PUBLISHED_ROUGHNESS)
    if true_emission.any() and "emission" in estimate:
        emission = np.where(emits(estimate)[..., None], estimate["emission"], 0.0)
        found = emission.sum(axis=-1) > 0
        figures["emission_iou"] = float((found & true_emission).sum() / (found | true_emission).sum())
        difference = np.log1p(np.float64(emission)) - np.log1p(np.float64(truth["emission"]))
        figures["log_l2"] = float(np.mean(difference**2))
    return figures


def published_mean(views: Iterable[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Mean of each figure over the views that have it; None where no view has it."""
    names = ("kd_psnr", "reflectance_psnr", "roughness_psnr", "emission_iou", "log_l2")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for view in views:
        for name in names:
            if (value := view[name]) is not None:
                columns[name].append(value)
    return {name: float(np.mean(values)) if values else None for name, values in columns.items()}


def image_psnr(
    image: np.ndarray, reference: np.ndarray, valid: np.ndarray | None = None, scale: float = 1.0
) -> float | None:
    """PSNR of an image after clipping to [0, 1] and the sRGB curve, dB.

    Parameters
    ----------
    image, reference
        (H, W, 3) linear radiance, finite.
    valid
        (H, W) weights; pixels with weight 0 are left out. All count where it is absent.
    scale
        Exposure factor applied to ``image``.

    Returns
    -------
    float or None
        None if no pixel is valid.
    """
    counted = np.ones(reference.shape[:2], bool) if valid is None else valid > 0
    error = Mean()
    encoded = [
        srgb_encode(np.clip(np.asarray(shown[counted], np.float64), 0.0, 1.0))
        for shown in (scale * np.asarray(image, np.float64), reference)
    ]
    error.add((encoded[0] - encoded[1]) ** 2)
    return psnr(error.value)


@dataclass
class RenderExposure:
    """The one factor that brings all renderings nearest to their photographs, by least squares.

    Pixels clipped in the photograph's display range (a channel >= 1) do not take part: lamps would
    decide alone.
    """

    product: float = 0.0
    square: float = 0.0

    def add(self, image: np.ndarray, photo: np.ndarray, valid: np.ndarray) -> None:
        """Take in one view: (H, W, 3) linear radiance twice, (H, W) weights."""
        counted = (valid > 0) & (photo < 1.0).all(axis=-1)
        rendered, seen = np.float64(image[counted]), np.float64(photo[counted])
        self.product += float(np.sum(rendered * seen))
        self.square += float(np.sum(rendered**2))

    @property
    def scale(self) -> float:
        """The factor for the rendering; 1 if nothing can be said."""
        return self.product / self.square if self.product > 0 else 1.0


@dataclass
class PhotographedExposure:
    """The one factor that brings photographs of unknown exposure to the radiance of renderings.

    Least absolute differences of log luminance, smoothed to squares near 0 (Huber): a lamp, a clipped window or a
    thing that was moved decides nothing.
    """

    differences: list[np.ndarray] = field(default_factory=list)

    def add(self, image: np.ndarray, photo: np.ndarray, valid: np.ndarray) -> None:
        """Take in one view: (H, W, 3) linear radiance twice, (H, W) weights."""
        rendered, seen = (np.asarray(shown[valid > 0], np.float64) @ np.array(LUMINANCE) for shown in (image, photo))
        both = (rendered > 0) & (seen > 0)
        differences = np.log(rendered[both]) - np.log(seen[both])
        self.differences.append(differences[:: max(1, len(differences) // _COMPARED)])

    @property
    def scale(self) -> float | None:
        """The factor for the photographs; None if no pixel can be compared."""
        differences = np.concatenate([np.zeros(0), *self.differences])
        if len(differences) == 0:
            return None
        middle = np.median(differences)
        for _ in range(20):
            weight = 1 / np.maximum(np.abs(differences - middle), _HUBER)
            middle = weight @ differences / weight.sum()
        return float(np.exp(middle))
