"""Depth maps closed by the room's walls, where nothing else tells what a pixel shows."""

import numpy as np

from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.other_views import THROUGH, OtherViews
from fipt.stages.geometry.room_box import RoomBox

_CLOSED = 1e-3
"""Confidence of a closed pixel, in units of the view's median: any other depth outweighs it."""
_EVERY = 4
"""Pixels along a row and a column of which other views are asked about one."""


def closed(view: DepthView, number: int, others: OtherViews, box: RoomBox, noise: float) -> DepthView:
    """Put the nearest wall that the other views do not see through into unknown pixels; else the box's face behind it.

    Pixels stay unknown where the box has no wall on that side: it ends anywhere then.

    Parameters
    ----------
    number
        Of this view among the others.
    noise
        Deviation of depth at one metre, metres.
    """
    found = view.map
    rays = view.rays.reshape(-1, 3)
    nearest, normal, walled = _faces(view, rays, box)
    for side, axis in zip(*np.nonzero(np.isfinite(box.walls)), strict=True):
        wall = box.directions[axis] * (1.0 if side == 0 else -1.0)
        toward, before = -rays @ wall, wall @ view.camera.center - (wall @ box.directions[axis]) * box.walls[side, axis]
        if before <= 0:
            continue
        depth = np.where(toward > 1e-6, before / np.maximum(toward, 1e-6), np.inf)
        nearer = (depth < nearest) & ~_seen_through(view, number, others, depth, noise)
        nearest = np.where(nearer, depth, nearest)
        normal[nearer] = wall
        walled |= nearer
    add = ~found.known & walled.reshape(found.depth.shape)
    usual = float(np.median(found.confidence[found.known])) if found.known.any() else 1.0
    return view.with_map(
        DepthMap(
            np.where(add, nearest.reshape(add.shape), found.depth).astype(np.float32),
            np.where(add, _CLOSED * usual, found.confidence).astype(np.float32),
            np.where(add[..., None], normal.reshape(*add.shape, 3), found.normal).astype(np.float32),
        )
    )


def _faces(view: DepthView, rays: np.ndarray, box: RoomBox) -> tuple[np.ndarray, ...]:
    """Depth (N,) at which (N, 3) rays leave the box, inward normals (N, 3), and (N,) whether a wall is on that side."""
    along = rays @ box.directions.T
    end = np.where(along > 0, box.high, box.low) - box.directions @ view.camera.center
    depth = np.where(np.abs(along) > 1e-9, end / np.where(np.abs(along) > 1e-9, along, 1.0), np.inf)
    axis = depth.argmin(axis=1)
    sign = np.sign(np.take_along_axis(along, axis[:, None], 1))
    walled = np.isfinite(box.walls[(sign[:, 0] > 0).astype(np.int64), axis])
    return np.maximum(depth.min(axis=1), 1e-3), -sign * box.directions[axis], walled


def _seen_through(view: DepthView, number: int, others: OtherViews, depth: np.ndarray, noise: float) -> np.ndarray:
    """(N,) bool: pixels whose surrounding, were it at these depths, other views see through."""
    shape = view.map.depth.shape
    some = np.s_[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    there = depth.reshape(shape)[some]
    reached = np.isfinite(there)
    points = view.camera.center + view.rays[some][reached] * there[reached][:, None]
    through, same = others.say(points, number, noise)
    free = np.zeros(there.shape, bool)
    free[reached] = through > np.maximum(1, THROUGH * (through + same))
    row, column = (
        np.minimum(np.arange(size) // _EVERY, blocks - 1) for size, blocks in zip(shape, there.shape, strict=True)
    )
    return free[row[:, None], column].ravel()
