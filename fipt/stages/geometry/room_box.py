"""The room's box: the walls along its directions, by where surface that faces them gathers, and what they enclose."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.stages.geometry.depth_views import DepthView

_OUTMOST = 0.001
"""Share of known points that may lie outside the box: wrong depths, and what windows show."""
_BEHIND = 0.25
"""Share of them that may lie behind a wall: niches and windows do, most of a room does not."""
_PAST = 0.02
"""Share of known points that may be seen past a wall: wrong depths (1 % at walls of three rooms; 18 % at a table's top,
3 % at the fronts of a kitchen)."""
_FEW = 0.5
"""As many as so many of its own points may be in any case: a bare wall has few."""
_SIDES = 0.02
"""Share of a wall's points that may lie beyond its sides."""
_REST = 0.05
"""Of the surface of a face inside the room a wall behind it must have."""
_FACES = np.cos(np.radians(20.0))
"""Cosine between a wall and the normals of its points, at least: those of small windows are rough."""
_BIN = 0.01
"""Metres along a direction that are one place."""
_PLACE = 2
"""Places on either side that noise and a wall's unevenness move points by."""
UNEVENNESS = _PLACE * _BIN
"""Metres by which points of a wall lie before and behind its place."""
_LEAST = 30
"""Known points of a wall."""


@dataclass(frozen=True)
class RoomBox:
    """A box around the room, and its walls.

    Attributes
    ----------
    directions
        (3, 3) float64 the room's directions, rows.
    low, high
        (3,) float64 extent along them, metres: to the walls, or as far as points lie behind them.
    walls
        (2, 3) float64 metres along the directions; the first row faces up them, the second down. NaN where no surface
        faces that way.
    inner
        Faces inside the room that have more surface than the wall behind them, such as the top of a table: row of the
        walls that face the same way, direction, and place along it.
    """

    directions: np.ndarray
    low: np.ndarray
    high: np.ndarray
    walls: np.ndarray
    inner: tuple[tuple[int, int, float], ...] = ()

    @property
    def faces(self) -> list[tuple[int, int, float]]:
        """Walls and inner faces."""
        walls = zip(*np.nonzero(np.isfinite(self.walls)), strict=True)
        return [*((int(side), int(axis), float(self.walls[side, axis])) for side, axis in walls), *self.inner]

    def plain(self) -> dict[str, Any]:
        """The box and its walls as plain types, for JSON; null where there is no wall."""
        walls = [[None if np.isnan(value) else round(float(value), 5) for value in row] for row in self.walls]
        ends = {name: np.round(getattr(self, name), 5).tolist() for name in ("low", "high")}
        inner = [[side, axis, round(place, 5)] for side, axis, place in self.inner]
        return {"directions": np.round(self.directions, 6).tolist(), **ends, "walls": walls, "inner": inner}

    def holds(self, points: np.ndarray, tolerance: float) -> bool:
        """Whether all of (N, 3) points lie inside, or not farther outside than the tolerance."""
        along = points @ self.directions.T
        return bool((along > self.low - tolerance).all() and (along < self.high + tolerance).all())

    def before_walls(self, points: np.ndarray, tolerance: float) -> bool:
        """Whether none of (N, 3) points lies farther behind a wall than the tolerance and the wall's unevenness."""
        along, tolerance = points @ self.directions.T, tolerance + UNEVENNESS
        return not ((along < self.walls[0] - tolerance).any() or (along > self.walls[1] + tolerance).any())


def find_box(views: Sequence[DepthView], directions: np.ndarray) -> RoomBox:
    """Find the box of a room; its walls face the cameras."""
    known = [view.map.known for view in views]
    points = np.concatenate([view.points[k] for view, k in zip(views, known, strict=True)]) @ directions.T
    facing = np.concatenate([view.map.normal[k] for view, k in zip(views, known, strict=True)]) @ directions.T
    area = np.concatenate([(view.map.depth[k] / view.camera.fx) ** 2 for view, k in zip(views, known, strict=True)])
    centers = np.array([view.camera.center for view in views]) @ directions.T
    seen_from = np.repeat(centers, [int(k.sum()) for k in known], axis=0)
    walls, inner = np.full((2, 3), np.nan), []
    # ledges in windows count for no ceiling once the walls are known; nor does a garden then lie past a wall beside it
    for most in (1.0, _PAST, _PAST):
        low, high = np.fmin(walls[0], centers.min(axis=0)), np.fmax(walls[1], centers.max(axis=0))
        open_low, open_high = np.where(np.isnan(walls[0]), -np.inf, low), np.where(np.isnan(walls[1]), np.inf, high)
        inside = (points > open_low - UNEVENNESS) & (points < open_high + UNEVENNESS)
        found, inner = np.full((2, 3), np.nan), []
        for axis in range(3):
            between = np.all(inside[:, [i for i in range(3) if i != axis]], axis=1)
            for side, sign in enumerate((1.0, -1.0)):
                along, nearest = sign * points[:, axis], float((sign * centers[:, axis]).min())
                on = between & (sign * facing[:, axis] > _FACES) & (along < nearest)
                rays = _Rays(np.roll(points, 2 - axis, axis=1), np.roll(seen_from, 2 - axis, axis=1), sign)
                place, before = _wall(along, between, on, area, rays, most)
                found[side, axis] = sign * place
                inner += [(side, axis, sign * each) for each in before]
        walls = found
    # walls are the ends where little lies behind them; else points are
    ends = [np.quantile(points, q, axis=0) if len(points) else centers[0] for q in (_OUTMOST, 1 - _OUTMOST)]
    beyond = (points < walls[0] - UNEVENNESS).mean(axis=0), (points > walls[1] + UNEVENNESS).mean(axis=0)
    low, high = np.where((np.array(beyond) < 10 * _OUTMOST) & np.isfinite(walls), walls, ends)
    low, high = np.minimum(low, centers.min(axis=0)), np.maximum(high, centers.max(axis=0))
    return RoomBox(directions, low, high, walls, tuple(inner))


@dataclass(frozen=True)
class _Rays:
    """Known points (N, 3) and the cameras (N, 3) that see them, a wall's direction last; -1 if it faces down it."""

    points: np.ndarray
    seen_from: np.ndarray
    sign: float

    def past(self, place: float, on: np.ndarray, behind: np.ndarray) -> float:
        """Share of all points that lie ``behind`` (N,) a place and are seen past the surface ``on`` it (K,).

        Openings of a wall lie within it; what is seen past the top of a table does not.
        """
        if not behind.any():
            return 0.0
        there, here = self.points[behind], self.seen_from[behind]
        share = (self.sign * place - here[:, 2]) / np.where(there[:, 2] == here[:, 2], np.inf, there[:, 2] - here[:, 2])
        crossing = here[:, :2] + share[:, None] * (there - here)[:, :2]
        low, high = np.quantile(self.points[on, :2], (_SIDES, 1 - _SIDES), axis=0)
        return float(((crossing < low) | (crossing > high)).any(axis=1).sum() / len(behind))


def _wall(
    along: np.ndarray, between: np.ndarray, on: np.ndarray, area: np.ndarray, rays: _Rays, most: float
) -> tuple[float, list[float]]:
    """Place, metres along a direction, where most surface gathers that faces it; else NaN.

    Little lies behind it, and of what is ``between`` the other walls no more than ``most`` of all points is seen past
    it. Places before it with more surface, for which that does not hold, come beside.
    """
    before: list[float] = []
    if on.sum() < _LEAST:
        return np.nan, before
    first = np.floor(along[on].min() / _BIN) - _PLACE
    place = (np.floor(along[on] / _BIN) - first).astype(np.int64)
    count = int(place.max()) + 1 + _PLACE
    near = np.ones(2 * _PLACE + 1)
    mass = np.convolve(np.bincount(place, area[on], count), near, "same")
    points = np.convolve(np.bincount(place, minlength=count), near, "same")
    behind = np.searchsorted(np.sort(along), (first + np.arange(count) - _PLACE) * _BIN) / len(along)
    left = np.where((behind < _BEHIND) & (points >= _LEAST), mass, 0.0)
    while left.any():
        best = int(left.argmax())
        own = np.flatnonzero(on)[np.abs(place - best) <= _PLACE]
        found = float(np.median(along[own]))
        if rays.past(found, own, between & (along < found - UNEVENNESS)) <= max(most, _FEW * len(own) / len(along)):
            return found, before
        before.append(found)
        left[max(best - 2 * _PLACE, 0) :] = 0.0  # what bounds the room lies behind what is inside
        left[left < _REST * mass[best]] = 0.0
    return np.nan, before
