"""Directions that leave the mesh without a surface, though no light comes from outside: holes.

From seen surface, directions are drawn with the density with which light counts (the cosine), so that their share is
the share of the light that is lost there.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, share_error

_POINTS = 2000
_DIRECTIONS = 16
_CELLS = 16
"""Cells along the longest side of the room, in which the place of a hole is told."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell holes through which much of the light would come."""
    if room.fitted.environment.mode != "none":
        return []
    origins, directions = rays(room)
    if not len(origins):
        return []
    _, triangle = room.rays.intersect(origins, directions)
    lost = triangle < 0
    share = float(lost.mean())
    measure = Measure("directions from the surface that meet nothing", share, TOLERANCE)
    level = notes.judge("holes", measure, share_error(share, len(origins) / _DIRECTIONS))
    if level is None:
        return []
    place = exit_place(room, origins[lost], directions[lost])
    text = ", ".join(f"{v:.1f}" for v in place)
    return [
        RoomFinding(
            "holes",
            level,
            f"{100 * share:.0f} % of the light's directions leave the mesh through holes, most near ({text}); what "
            "comes from there is taken to be black.",
            measure,
            "Scan what is missing or close the holes; if it is a window, let photographs show the outside "
            "(environment.mode).",
            {"position": [round(float(v), 2) for v in place]},
            image=plan(room.mesh, [each.camera for each in room.retakes], room.fitted.emitters, [("hole", place)]),
        )
    ]


def rays(room: JudgedRoom) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (N, 3) float32 off seen surface, cosine distributed."""
    pixels, rng = room.explained, np.random.default_rng(room.settings.seed)
    chosen = rng.choice(len(pixels), min(_POINTS, len(pixels)), replace=False) if len(pixels) else np.zeros(0, int)
    normal = np.repeat(pixels.normal[chosen], _DIRECTIONS, axis=0).astype(np.float64)
    sphere = rng.normal(size=normal.shape)
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    directions = normal + sphere  # a point of the unit sphere around the normal's end: cosine distributed
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    lift = room.rays.epsilon
    origins = np.repeat(pixels.position[chosen], _DIRECTIONS, axis=0) + lift * normal
    return origins.astype(np.float32), directions.astype(np.float32)


def exit_place(room: JudgedRoom, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(3,) where most lost rays cross the mesh's bounding box."""
    low, high = room.mesh.vertices.min(axis=0), room.mesh.vertices.max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(directions > 0, (high - origins) / directions, (low - origins) / directions)
    distance = np.nanmin(np.where(np.isfinite(far), far, np.inf), axis=1)
    points = origins + np.maximum(distance, 0)[:, None] * directions
    size = float((high - low).max()) / _CELLS
    _, cell, count = np.unique(np.floor((points - low) / size), axis=0, return_inverse=True, return_counts=True)
    return np.median(points[cell.reshape(-1) == count.argmax()], axis=0)
