"""Edges of the fit beside those of the photographs: poses, or a mesh whose rims are off.

In patches with strong edges the fit is moved against the photograph along its own gradient, by least squares on
logarithms of radiance (one step of Lucas and Kanade): the displacement in pixels across the patch's edge. Errors of
material and shading have no preferred side, and cancel.
"""

import numpy as np

from fipt.scene.display import tone_mapped
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import row
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.patches import SIDE, EdgePatches
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, median_error

_STRONG = 1.0
"""Sum of squared logarithmic slopes across the edge from which on a patch is judged: an edge of contrast 2 has more."""
_FEWEST = 20
"""Patches."""
_SHOWN = 6


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell edges that are not where photographs show them."""
    patches = room.patches
    if len(patches.view) < _FEWEST:
        return []
    offset = displacements(patches)
    judged = np.flatnonzero(np.isfinite(offset))
    if len(judged) < _FEWEST:
        return []
    off = np.abs(offset[judged])
    # displaced by d pixels, a pixel at an edge takes the share d of its light from the other side
    measure = Measure("displacement of edges, fit against photographs", float(np.median(off)), TOLERANCE, "pixels")
    level = notes.judge("edges-off", measure, median_error(off))
    if level is None:
        return []
    worst = judged[np.argsort(-off)]
    views = list(dict.fromkeys(patches.view[k] for k in worst))
    prepared = room.prepared.get("noise_mm")
    noise = f" (noise of its vertices: {prepared:.1f} mm)" if prepared else ""
    return [
        RoomFinding(
            "edges-off",
            level,
            f"Edges are not where the photographs show them: by {measure.value:.2f} pixels typically. Poses or the "
            f"rims of the mesh are off{noise}.",
            measure,
            "Check the poses (check_poses.enabled), or give a finer mesh; colours beside edges are not to be trusted.",
            {"views": views[:_SHOWN]},
            {"ninety_percent_below": float(np.percentile(off, 90))},
            image=_drawn(room, patches, worst[:_SHOWN]),
        )
    ]


def displacements(patches: EdgePatches) -> np.ndarray:
    """(P,) signed displacement across each patch's edge, pixels; NaN where the fit has no strong edge."""
    photo, predicted = patches.photo.mean(axis=-1), patches.predicted.mean(axis=-1)
    little = 0.05 * float(np.median(photo)) + 1e-9
    photo, predicted = np.log(photo + little), np.log(predicted + little)
    down, across = (np.gradient(predicted, axis=axis)[:, 1:-1, 1:-1].reshape(len(photo), -1) for axis in (1, 2))
    left = (predicted - photo)[:, 1:-1, 1:-1].reshape(len(photo), -1)
    left = left - np.median(left, axis=1, keepdims=True)
    slope = np.stack([down, across], axis=-1)
    strength, direction = np.linalg.eigh(slope.swapaxes(1, 2) @ slope)
    along = (slope @ direction[:, :, 1:])[..., 0]
    strong = strength[:, 1] > _STRONG
    return np.where(strong, (along * left).sum(axis=1) / np.where(strong, strength[:, 1], 1), np.nan)


def _drawn(room: JudgedRoom, patches: EdgePatches, chosen: np.ndarray) -> np.ndarray:
    """Photographs of some patches above what the fit says of them."""
    columns = {
        f"{patches.view[k]} ({patches.corner[k, 1]}, {patches.corner[k, 0]})": tone_mapped(
            np.concatenate([patches.photo[k], np.ones((1, SIDE, 3)), patches.predicted[k]]), room.exposure
        )
        for k in chosen
    }
    return row(columns)
