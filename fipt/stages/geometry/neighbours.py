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


def choose_sources(cameras: Sequence[Camera], count: int, nearest: float) -> list[list[int]]:
    """Choose the sources of every view by the cameras alone: those that show most of it from another place.

    Parameters
    ----------
    count
        Sources of a view, at most.
    nearest
        Least distance of a surface, metres: it may be anywhere from three to twenty times as far, in a room.

    Returns
    -------
    list
        For every camera the places of its sources in the list, best first; fewer than two where it has none.

    Raises
    ------
    FiptError
        If fewer than three views overlap, or all stand in one place.
    """
    compared = [_compared(cameras, i, _points(camera, nearest)) for i, camera in enumerate(cameras)]
    chosen = [_best(shared, weight, count) for shared, weight, _ in compared]
    widest = max((widest for _, _, widest in compared), default=0.0)
    if widest < _PARALLAX and max((shared.max() for shared, _, _ in compared), default=0.0) >= _SHARED:
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


def choose_again(
    cameras: Sequence[Camera], count: int, depths: Sequence[np.ndarray], chosen: Sequence[list[int]]
) -> list[list[int]]:
    """Choose sources by a first depth: views where something stands in the way are left out.

    Parameters
    ----------
    depths
        Depth maps of the views, (H, W) metres, 0 where unknown.
    chosen
        Sources by the cameras alone. A view keeps them where its depth is unknown, or leaves it fewer than two.
    """
    result = []
    for i, camera in enumerate(cameras):
        points = _known_points(camera, depths[i])
        row = _best(*_compared(cameras, i, points, depths)[:2], count) if len(points) else []
        result.append(row if len(row) >= 2 else list(chosen[i]))
    return result


def _compared(
    cameras: Sequence[Camera], i: int, points: np.ndarray, depths: Sequence[np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Share of a view's (N, 3) points that each view shows, (V,), how well it suits, (V,), and the widest angle."""
    weight, shared, widest = np.zeros(len(cameras)), np.zeros(len(cameras)), 0.0
    for j, other in enumerate(cameras):
        if i == j:
            continue
        inside, angle, ratio = _seen(cameras[i], other, points)
        if depths is not None:
            inside &= _unhidden(other, points, depths[j])
        shared[j] = inside.mean()
        if inside.any():
            widest = max(widest, float(np.quantile(angle[inside], 0.9)))
        spread = np.where(angle < _ANGLE, _NARROW, _WIDE)
        fits = np.exp(-0.5 * ((angle - _ANGLE) / spread) ** 2) * np.minimum(ratio, 1 / ratio)
        weight[j] = np.mean(fits * inside)
    return shared, weight, widest


def _best(shared: np.ndarray, weight: np.ndarray, count: int) -> list[int]:
    order = np.argsort(-weight, kind="stable")[:count]
    return [int(j) for j in order if shared[j] >= _SHARED and weight[j] > 1e-6]


def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and (N, 3) rays to depth 1 of the pixels by which views are compared."""
    rows = (np.arange(_GRID) + 0.5) / _GRID * camera.height
    columns = (np.arange(_GRID) + 0.5) / _GRID * camera.width
    column, row = (part.ravel() for part in np.meshgrid(columns, rows))
    return column, row, camera.rays(column, row)


def _points(camera: Camera, nearest: float) -> np.ndarray:
    """(N, 3) world points that a camera may see."""
    away = np.geomspace(3.0, 20.0, _DEPTHS) * nearest
    return (camera.center + _rays(camera)[2][:, None] * away[:, None]).reshape(-1, 3)


def _known_points(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """(N, 3) world points that a camera with its depth sees."""
    column, row, rays = _rays(camera)
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
