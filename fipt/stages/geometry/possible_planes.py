"""Which planes a superpixel of a view may show."""

from dataclasses import dataclass

import numpy as np

from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.other_views import THROUGH, OtherViews
from fipt.stages.geometry.photo_consistency import Radiances
from fipt.stages.geometry.room_box import RoomBox
from fipt.stages.geometry.room_planes import WITHIN
from fipt.stages.geometry.superpixels import Superpixels

_PROBES = 5
"""Pixels of a superpixel that other views are asked about."""

Probes = list[tuple[np.ndarray, np.ndarray]]
"""Rows and columns of some pixels of each superpixel."""


@dataclass(frozen=True)
class PossiblePlanes:
    """What speaks against planes in the superpixels of a view.

    Attributes
    ----------
    number
        Of the view.
    view
        The view.
    slopes
        (P, 3) planes, see `RoomPlanes.slopes`.
    probes
        Pixels that are asked about.
    alike
        (S, P) bool: planes that other views' radiance does not speak against.
    others
        Depth of all views.
    box
        The room's.
    noise
        Deviation of depth at one metre, metres.
    """

    number: int
    view: DepthView
    slopes: np.ndarray
    probes: Probes
    alike: np.ndarray
    others: OtherViews
    box: RoomBox
    noise: float

    def __call__(self, piece: int, plane: int) -> bool:
        """Whether a superpixel may show a plane: in the room, and no view sees through it, or another radiance there.

        Behind a wall, as panes of windows are, another view must know of it.
        """
        if not self.alike[piece, plane]:
            return False
        row, column = self.probes[piece]
        q = self.view.rays[row, column] @ self.slopes[plane]
        if (q <= 0).any():
            return False
        points = self.view.camera.center + self.view.rays[row, column] / q[:, None]
        tolerance = WITHIN * self.noise / q.min() ** 2
        if not self.box.holds(points, tolerance):
            return False
        through, there = (int(votes.sum()) for votes in self.others.say(points, self.number, self.noise))
        if there == 0 and not self.box.before_walls(points, tolerance):
            return False  # a pane goes on over no wall
        return through <= max(1.0, THROUGH * (through + there))


def probes_of(pieces: Superpixels) -> Probes:
    """Some pixels of each superpixel, evenly chosen."""
    flat = pieces.label.ravel()
    order = np.argsort(flat, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(flat))[:-1])
    return [np.divmod(part[:: max(1, len(part) // _PROBES)], pieces.label.shape[1]) for part in parts]


def alike(radiances: Radiances, number: int, slopes: np.ndarray, probes: Probes, box: RoomBox) -> np.ndarray:
    """(S, P) bool: planes of superpixels that none beats by more than a deviation.

    What is compared is the share of the views that agree, of those that show the place, by Laplace's rule of
    succession: a plane that few views show may stay. The best plane lies in the room.
    """
    if len(slopes) == 0:
        return np.zeros((len(probes), 0), bool)
    row, column = (np.concatenate(list(part)) for part in zip(*probes, strict=True))
    count = np.array([len(part) for part, _ in probes])
    first = np.cumsum(count) - count
    agree, show = (
        np.add.reduceat(votes, first) / count[:, None] for votes in radiances.agreement(number, row, column, slopes)
    )
    share = (agree + 1) / (show + 2)
    variance = share * (1 - share) / (show + 3)
    middle = first + count // 2
    view = radiances.views[number]
    rays = view.rays[row[middle], column[middle]]
    inverse = rays @ slopes.T
    before = inverse > 1e-3
    along = (view.camera.center + rays[:, None] / np.where(before, inverse, 1.0)[..., None]) @ box.directions.T
    inside = before & ((along > box.low) & (along < box.high)).all(axis=-1)
    best = np.where(inside, share, -1.0).argmax(axis=1)[:, None]
    worse = np.take_along_axis(share, best, 1) - share
    bound = np.sqrt(variance + np.take_along_axis(variance, best, 1))
    return np.logical_or(worse <= bound, ~inside.any(axis=1, keepdims=True))
