"""The plot of predicted against found errors, by class of confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fipt.stages.report.images import EmbeddedImage, embedded

_PLOTS = (("kd_psnr", "kd, dB"), ("roughness_l1", "roughness, L1"), ("metallic_l1", "metallic, L1"))
_WIDTH = 960
_FACTOR = 1.5
"""Half the width of the band, as a ratio: between its edges prediction and truth agree."""
_SMALLEST_L1 = 1e-3
_COLOR = "#1f5fa8"


def calibration_plot(metrics: Mapping[str, Any]) -> EmbeddedImage | None:
    """Found over predicted errors, a point a class of the held-out views (or of the training views).

    The larger a point, the more pixels; the band holds errors within a factor of 1.5. None without predictions.
    """
    groups = (metrics.get(split) or {} for split in ("val", "train"))
    classes = next((rows for group in groups if (rows := group.get("by_confidence"))), [])
    drawn = [[row for row in classes if _known(row, key)] for key, _ in _PLOTS]
    if not any(drawn):
        return None
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 3.2), dpi=100)
    canvas = FigureCanvasAgg(figure)
    for number, ((key, title), rows) in enumerate(zip(_PLOTS, drawn, strict=True)):
        _plot(figure.add_subplot(1, len(_PLOTS), number + 1), rows, key, title)
    figure.tight_layout()
    canvas.draw()
    src, width, height = embedded(np.asarray(canvas.buffer_rgba()), _WIDTH)
    return EmbeddedImage("calibration", "Predicted against found errors", src, width, height)


def _known(row: Mapping[str, Any], key: str) -> bool:
    return row.get(key) is not None and row.get(f"predicted_{key}") is not None


def _plot(axes: Any, rows: Sequence[Mapping[str, Any]], key: str, title: str) -> None:
    axes.set(title=title, xlabel="predicted", ylabel="found")
    if not rows:
        return
    in_db = key.endswith("psnr")
    values = np.array([[row[f"predicted_{key}"], row[key]] for row in rows])
    values = values if in_db else np.maximum(values, _SMALLEST_L1)
    factor = 10 ** (0.05 * (values.max() - values.min())) if in_db else values.max() / values.min()
    margin = max(factor ** (1 / 8), _FACTOR)
    low, high = _scaled(values.min(), 1 / margin, in_db), _scaled(values.max(), margin, in_db)
    line = np.array([low, high])
    axes.fill_between(line, _scaled(line, 1 / _FACTOR, in_db), _scaled(line, _FACTOR, in_db), color=_COLOR, alpha=0.12)
    axes.plot(line, line, color=_COLOR, linewidth=0.8)
    axes.scatter(*values.T, s=[20 + 300 * row["share"] for row in rows], color=_COLOR, alpha=0.7)
    if not in_db:
        axes.set(xscale="log", yscale="log")
    axes.set(xlim=(low, high), ylim=(low, high))


def _scaled(value: Any, factor: float, in_db: bool) -> Any:
    """A value in decibels, or an error, times a factor of amplitude."""
    return value + 20 * np.log10(factor) if in_db else value * factor
