"""The room's box: the outermost planes along its directions, which hold all that views see."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.room_planes import RoomPlanes

_OUTMOST = 0.001
"""Share of known points that may lie outside a wall: wrong depths, and what windows show."""
_WALL = 0.1
"""Area of a wall, in those of the largest plane along the same direction, at least: shelves end before walls do."""
_EVERY = 7
"""Pixels of which one stands for the others."""


@dataclass(frozen=True)
class RoomBox:
    """A box around the room.

    Attributes
    ----------
    directions
        (3, 3) float64 the room's directions, rows.
    low, high
        (3,) float64 extent along them, metres: to the outermost plane, else as far as points do.
    """

    directions: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def holds(self, points: np.ndarray, tolerance: float) -> bool:
        """Whether all of (N, 3) points lie inside, or not farther outside than the tolerance."""
        along = points @ self.directions.T
        return bool((along > self.low - tolerance).all() and (along < self.high + tolerance).all())


def find_box(views: Sequence[DepthView], planes: RoomPlanes) -> RoomBox:
    """Find the box of a room; its walls face the cameras."""
    points = np.concatenate([view.points[view.map.known][::_EVERY] for view in views])
    centers = np.array([view.camera.center for view in views])
    ends = np.zeros((2, 3))
    for axis, direction in enumerate(planes.directions):
        along, inner = points @ direction, centers @ direction
        for side, (sign, limit) in enumerate(((1.0, _OUTMOST), (-1.0, 1 - _OUTMOST))):
            extreme = float(np.quantile(along, limit)) if len(along) else float(inner.mean())
            innermost = inner.min() if side == 0 else inner.max()
            ends[side, axis] = min(extreme, innermost) if side == 0 else max(extreme, innermost)
            facing = (planes.axis == axis) & (sign * (planes.normal @ direction) > 0)
            if not facing.any():
                continue
            large = facing & (planes.area >= _WALL * planes.area[facing].max())
            height = planes.offset * np.sign(planes.normal @ direction)
            outermost = float(height[large].min() if side == 0 else height[large].max())
            # what lies behind the last plane is seen through it, or is not of the room
            behind = float((along < outermost - 0.05).mean() if side == 0 else (along > outermost + 0.05).mean())
            if behind < 10 * _OUTMOST and (sign * (innermost - outermost) > 0):
                ends[side, axis] = outermost
    return RoomBox(planes.directions, ends[0], ends[1])
