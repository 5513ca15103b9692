"""Silhouettes that are off: photograph and mesh disagree about where an edge is.

Pixels within two of an edge of depth are compared with those further away: how many of them does the fit miss by more
than twice the tolerance? Where poses and mesh are right, mixed pixels are explained like others.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.light_balance import usable
from fipt.stages.findings.drawing import compared, log_ratio
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.retakes import Retake
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, median_error

_STEP = 0.05
"""Relative step of depth that is an edge."""
_FAR = 4
"""Pixels from an edge on which count as far."""
_EXCESS = 0.25
"""Share of the pixels at edges, beyond that elsewhere, that may be missed."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell edges that are not where photographs show them."""
    found = [(retake, share) for retake in room.retakes if (share := _excess(retake)) is not None]
    if len(found) < 2:
        return []
    excess = np.array([share for _, share in found])
    measure = Measure("pixels at edges missed, beyond those elsewhere", max(float(np.median(excess)), 0.0), _EXCESS)
    level = notes.judge("silhouettes", measure, median_error(excess))
    if level is None:
        return []
    worst = found[int(excess.argmax())][0]
    return [
        RoomFinding(
            "silhouettes",
            level,
            f"Edges of the mesh are not where the photographs show them: {100 * measure.value:.0f} % more of the "
            "pixels at edges are wrong than elsewhere.",
            measure,
            "Check poses (check_poses.enabled) and the mesh's rims; pixels at edges teach wrong colours.",
            {"views": [worst.camera.name]},
            image=compared(worst.photo, worst.render, room.exposure, outlined=_edges(worst)),
        )
    ]


def _edges(retake: Retake) -> np.ndarray:
    """(H, W) bool: pixels beside a step of depth."""
    depth = np.linalg.norm(retake.position - retake.camera.center, axis=-1)
    depth = np.where(retake.triangle >= 0, depth, np.inf)
    edge = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        first, second = (
            np.take(depth, range(depth.shape[axis] - 1), axis),
            np.take(depth, range(1, depth.shape[axis]), axis),
        )
        with np.errstate(invalid="ignore"):
            step = np.abs(first - second) > _STEP * np.minimum(first, second)
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        edge |= np.pad(step, pad)
        pad[axis] = (1, 0)
        edge |= np.pad(step, pad)
    return edge


def _excess(retake: Retake) -> float | None:
    """Share of the pixels at edges that is missed, less that of pixels far from them."""
    from scipy.ndimage import distance_transform_edt

    edges, use = _edges(retake), usable(retake)
    if not edges.any():
        return None
    ratio = log_ratio(retake.render, retake.photo)
    missed = np.abs(ratio - np.median(ratio[use])) > 2 * TOLERANCE if use.any() else use
    far = use & (distance_transform_edt(~edges) >= _FAR)
    near = use & edges
    if near.sum() < 50 or far.sum() < 50:
        return None
    return float(missed[near].mean() - missed[far].mean())
