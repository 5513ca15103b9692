"""An image of cameras and points from above and from the side, and of the links between views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.formats.files import atomic
from fipt.scene.cameras import Camera
from fipt.stages.poses.evidence import Evidence
from fipt.stages.poses.model import Reconstruction

_GOOD, _BAD, _POINT = "#1f5fa8", "#d0312d", "#9a9a9a"
_POINTS_DRAWN = 20_000
_REASONS = 8
"""Rejected views whose reasons are written out."""


def draw(
    path: Path,
    model: Reconstruction,
    refused: Sequence[Camera],
    evidence: Mapping[str, Evidence],
    pairs: Sequence[tuple[str, str, int, int]],
) -> None:
    """Write the image: accepted cameras blue, rejected ones red, with their reasons below."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 6.4), dpi=100)
    FigureCanvasAgg(figure)
    up, upright = up_axis(model)
    across, along = (axis for axis in (0, 2, 1) if axis != up)
    above = _view(figure.add_subplot(1, 3, 1), model, refused, (across, along), "from above")
    if (np.cross(np.eye(3)[across], np.eye(3)[along])[up] > 0) != upright:
        above.invert_yaxis()  # or the room would be seen in a mirror
    _view(figure.add_subplot(1, 3, 2), model, refused, (across, up), "from the side")
    _graph(figure.add_subplot(1, 3, 3), evidence, pairs)
    reasons = [f"{name}: {e.reason}" for name, e in evidence.items() if e.reason is not None]
    more = [f"and {len(reasons) - _REASONS} more"] if len(reasons) > _REASONS else []
    lines = [*reasons[:_REASONS], *more]
    figure.text(0.02, 0.01, "\n".join(lines), color=_BAD, fontsize=8, va="bottom")
    figure.subplots_adjust(left=0.04, right=0.985, top=0.94, bottom=0.08 + 0.023 * len(lines))
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})


def up_axis(model: Reconstruction) -> tuple[int, bool]:
    """World axis nearest to the cameras' mean up, and whether it points upwards."""
    up = np.mean([camera.world_from_camera[:3, 1] for camera in model.cameras], axis=0)
    axis = int(np.abs(up).argmax())
    return axis, bool(up[axis] > 0)


def _view(plot: Any, model: Reconstruction, refused: Sequence[Camera], axes: tuple[int, int], title: str) -> Any:
    low, high = np.percentile(model.points, (1, 99), axis=0)  # a few points lie anywhere
    low, high = np.minimum(low, model.centers.min(axis=0)), np.maximum(high, model.centers.max(axis=0))
    margin = 0.1 * float((high - low).max())
    step = max(1, len(model.points) // _POINTS_DRAWN)
    plot.scatter(*model.points[::step, axes].T, s=0.4, color=_POINT, linewidths=0)
    for cameras, color in ((model.cameras, _GOOD), (refused, _BAD)):
        for camera in cameras:
            columns, rows = np.array([0.0, camera.width]), np.full(2, camera.height / 2)
            left, right = camera.center + margin * camera.directions(columns, rows)
            plot.plot(*np.array([camera.center, left, right, camera.center])[:, axes].T, color=color, linewidth=0.8)
            plot.annotate(camera.name, camera.center[list(axes)], fontsize=6, color=color)
    letters = "xyz"
    plot.set(
        xlabel=f"{letters[axes[0]]}, m",
        ylabel=f"{letters[axes[1]]}, m",
        title=title,
        xlim=(low[axes[0]] - margin, high[axes[0]] + margin),
        ylim=(low[axes[1]] - margin, high[axes[1]] + margin),
    )
    plot.set_aspect("equal", adjustable="box")
    return plot


def _graph(plot: Any, evidence: Mapping[str, Evidence], pairs: Sequence[tuple[str, str, int, int]]) -> None:
    """Views on a circle, a line for each pair, as strong as the points that it shares."""
    names = list(evidence)
    angle = np.pi / 2 - 2 * np.pi * np.arange(len(names)) / max(len(names), 1)
    place = {name: (np.cos(a), np.sin(a)) for name, a in zip(names, angle, strict=True)}
    most = max((shared for *_, shared in pairs), default=0) or 1
    for a, b, _, shared in pairs:
        ends, strength = np.array([place[a], place[b]]).T, np.sqrt(shared / most)
        if shared:
            plot.plot(*ends, color=_GOOD, linewidth=0.4 + 2.6 * strength, alpha=0.25 + 0.6 * strength)
        else:
            plot.plot(*ends, color=_POINT, linewidth=0.5, linestyle=":")
    for name, (x, y) in place.items():
        color = _GOOD if evidence[name].reason is None else _BAD
        side = "left" if x >= 0 else "right"
        plot.plot(x, y, "o", color=color, markersize=4)
        plot.annotate(name, (1.06 * x, 1.06 * y), fontsize=6, color=color, ha=side, va="center")
    plot.set(title="points that two views share (dotted: matches only)", xlim=(-1.5, 1.5), ylim=(-1.3, 1.3))
    plot.set_aspect("equal")
    plot.axis("off")
