"""Which other views a view is matched with."""

from collections.abc import Sequence

import numpy as np

from fipt.errors import FiptError
from fipt.scene.cameras import Camera

_GRID = 8
"""Pixels along a side of an image by which views are compared."""
_DEPTHS = 6
"""Distances that these pixels are tried at."""
_ANGLE = 12.0
"""Degrees between the two lines of sight that suit best: depth is told well, and the surface still looks alike."""
_NARROW, _WIDE = 5.0, 14.0
"""Degrees by which the angle may be smaller or larger: standard deviations of its weight."""
_SHARED = 0.1
"""Share of a view that another must show to be matched with it."""
_PARALLAX = 1.0
"""Degrees between lines of sight without which there is no depth."""


def choose_sources(
    cameras: Sequence[Camera], count: int, nearest: float, depths: Sequence[np.ndarray] | None = None
) -> list[list[int]]:
    """Choose the sources of every view: those that show most of it from another place.

    Parameters
    ----------
    count
        Sources of a view, at most.
    nearest
        Least distance of a surface, metres. Without depths, the surface may be anywhere from three to twenty times as
        far: a room.
    depths
        Depth maps of the views, (H, W) metres, 0 where unknown: what stands in another's way is left out then.

    Returns
    -------
    list
        For every camera the places of its sources in the list, best first; fewer than two where it has none.

    Raises
    ------
    FiptError
        If fewer than three views overlap, or all stand in one place.
    """
    weight, shared = np.zeros((len(cameras), len(cameras))), np.zeros((len(cameras), len(cameras)))
    widest = 0.0
    for i, camera in enumerate(cameras):
        points = _points(camera, nearest, None if depths is None else depths[i])
        for j, other in enumerate(cameras):
            if i == j or not len(points):
                continue
            inside, angle, ratio = _seen(camera, other, points)
            if depths is not None:
                inside &= _unhidden(other, points, depths[j])
            shared[i, j] = inside.mean()
            if inside.any():
                widest = max(widest, float(np.quantile(angle[inside], 0.9)))
            spread = np.where(angle < _ANGLE, _NARROW, _WIDE)
            fits = np.exp(-0.5 * ((angle - _ANGLE) / spread) ** 2) * np.minimum(ratio, 1 / ratio)
            weight[i, j] = np.mean(fits * inside)
    chosen = [
        [int(j) for j in np.argsort(-row, kind="stable")[:count] if shared[i, j] >= _SHARED and row[j] > 1e-6]
        for i, row in enumerate(weight)
    ]
    if widest < _PARALLAX and shared.max(initial=0.0) >= _SHARED:
        raise FiptError(
            f"depth needs views from different places; the {len(cameras)} cameras stand in one place, as in a panorama "
            f"(lines of sight differ by {widest:.2f} degrees at most)",
            "photograph from several places, or give a mesh",
        )
    good = sum(len(row) >= 2 for row in chosen)
    if good < 3:
        raise FiptError(
            f"depth needs at least 3 views that show the same surface from different places; {good} of "
            f"{len(cameras)} overlap with two others",
            "photograph more views that overlap, or give a mesh",
        )
    return chosen


def _points(camera: Camera, nearest: float, depth: np.ndarray | None) -> np.ndarray:
    """(N, 3) world points that a camera may see or, with its depth, sees."""
    rows = (np.arange(_GRID) + 0.5) / _GRID * camera.height
    columns = (np.arange(_GRID) + 0.5) / _GRID * camera.width
    column, row = np.meshgrid(columns, rows)
    column, row = column.ravel(), row.ravel()
    axis = -camera.world_from_camera[:3, 2]
    rays = camera.directions(column, row).astype(np.float64)
    rays /= (rays @ axis)[:, None]
    if depth is None:
        away = np.geomspace(3.0, 20.0, _DEPTHS) * nearest
        return (camera.center + rays[:, None] * away[:, None]).reshape(-1, 3)
    scale = depth.shape[1] / camera.width
    z = depth[(row * scale).astype(int), (column * scale).astype(int)]
    return camera.center + rays[z > 0] * z[z > 0, None]


def _seen(camera: Camera, other: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether points are in another's frame, degrees between the lines of sight, ratio of the distances."""
    pixels, depth = other.project(points)
    inside = (depth > 0) & (pixels > 0).all(axis=1) & (pixels < (other.width, other.height)).all(axis=1)
    a, b = points - camera.center, points - other.center
    length_a, length_b = np.linalg.norm(a, axis=1), np.maximum(np.linalg.norm(b, axis=1), 1e-9)
    cosine = (a * b).sum(axis=1) / (length_a * length_b)
    return inside, np.degrees(np.arccos(np.clip(cosine, -1, 1))), np.maximum(length_a, 1e-9) / length_b


def _unhidden(other: Camera, points: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Whether nothing stands before points in another view; also where that knows no depth."""
    pixels, away = other.project(points)
    scale = depth.shape[1] / other.width
    column = np.clip((pixels[:, 0] * scale).astype(int), 0, depth.shape[1] - 1)
    row = np.clip((pixels[:, 1] * scale).astype(int), 0, depth.shape[0] - 1)
    found = depth[row, column]
    return (found == 0) | (found > 0.9 * away)
