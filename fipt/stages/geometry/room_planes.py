"""Planes of a room: fitted to superpixels of single views, joined across views, brought to the room's directions."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.room_directions import cube_turns, sharpened
from fipt.stages.geometry.superpixels import Superpixels

WITHIN = 3.0
"""Deviations within which depth lies on a plane."""
_ROUNDS = 4
"""Refits without what lies farther; they have settled before."""
_FILLED = 0.6
"""Share of a superpixel's known pixels that must lie on its plane."""
_LEAST = 8
"""Known pixels of a superpixel that a plane is fitted to: a plane has three numbers, and some pixels are wrong."""
_LIES = 2.0
"""Root mean square distance of a superpixel's points from a plane that it lies on, in deviations: one is their noise,
and the depth of a whole superpixel errs together."""
_TURN = np.cos(np.radians(45.0))
"""Cosine between the normals of a plane and of a superpixel's own, at least: those of small ones are uncertain."""
_NEARLY = np.cos(np.radians(10.0))
"""Cosine to a direction above which a plane tells of the room's directions at first."""
_LEADING = 8
"""Largest planes that directions other than the world's axes are made of: walls, floor and ceiling are among them."""
_CLEARLY = 1.2
"""Times as much surface must lie along other directions than along the world's axes: most rooms are along these."""
_UPRIGHT = np.cos(np.radians(20.0))
"""Cosine between the cameras' mean up and one of other directions than the world's axes, at least: roof slopes at right
angles are no walls."""
_NO_FARTHER = 0.999
"""Share of the world's axes' cosine to the cameras' up that others must have where that is less: planes are noisy."""
_LEAST_UP = 0.5
"""Length of the cameras' mean up, of unit vectors, below which it tells nothing: they are held in many ways."""
_SNAP = np.cos(np.radians(3.0))
"""Cosine to one of the room's directions above which a plane is brought to it: walls are built so, and within noise."""
_SMALLEST = 0.05
"""Square metres that a plane shows in the view that sees most of it: a sheet of paper."""
_MOST_SEEDS = 3_000
"""Superpixels that are tried as the start of a plane, the largest first: a bound on time."""


@dataclass(frozen=True)
class RoomPlanes:
    """Planes of a room.

    Attributes
    ----------
    normal
        (K, 3) float64 unit normals towards the cameras that see them.
    offset
        (K,) float64 metres: normal . x = offset.
    sigma
        (K,) float64 deviation of the offset, metres.
    area
        (K,) float64 square metres in the view that shows most of it.
    views
        (K,) int64 views that show it.
    axis
        (K,) int64 0, 1, 2: along this direction of the room; -1: along none.
    directions
        (3, 3) float64 the room's directions, rows.
    """

    normal: np.ndarray
    offset: np.ndarray
    sigma: np.ndarray
    area: np.ndarray
    views: np.ndarray
    axis: np.ndarray
    directions: np.ndarray

    def __len__(self) -> int:
        """How many."""
        return len(self.offset)

    def plain(self) -> list[dict[str, Any]]:
        """The planes as plain types, for JSON."""
        return [
            {
                "normal": [round(float(value), 6) for value in self.normal[k]],
                "offset": round(float(self.offset[k]), 5),
                "offset_deviation": round(float(self.sigma[k]), 6),
                "area": round(float(self.area[k]), 4),
                "views": int(self.views[k]),
                "axis": None if self.axis[k] < 0 else "xyz"[self.axis[k]],
            }
            for k in range(len(self))
        ]

    def with_faces(self, faces: Sequence[tuple[int, int, float]], unevenness: float) -> "RoomPlanes":
        """Return them with the faces of the room's box that none of them is, along its directions.

        Parameters
        ----------
        faces
            Side, direction and place in metres along it; side 0 faces up the direction, 1 down.
        unevenness
            Deviation of a face's place, metres.
        """
        added = [row for row in self._faces(faces) if not self._same(*row, unevenness).any()]
        if not added:
            return self
        normal, offset, axis = (np.array(column) for column in zip(*added, strict=True))
        count = len(added)
        return RoomPlanes(
            np.concatenate([self.normal, normal]),
            np.append(self.offset, offset),
            np.append(self.sigma, np.full(count, unevenness)),
            np.append(self.area, np.zeros(count)),
            np.append(self.views, np.zeros(count, np.int64)),
            np.append(self.axis, axis),
            self.directions,
        )

    def among(self, faces: Sequence[tuple[int, int, float]], unevenness: float) -> np.ndarray:
        """(K,) bool: planes that are faces of the room's box, within its unevenness."""
        return np.any(
            [np.zeros(len(self), bool), *(self._same(*row, unevenness) for row in self._faces(faces))], axis=0
        )

    def _faces(self, faces: Sequence[tuple[int, int, float]]) -> list[tuple[np.ndarray, float, int]]:
        """Normal, offset and direction of faces."""
        normals = [self.directions[axis] * (1.0 if side == 0 else -1.0) for side, axis, _ in faces]
        return [
            (normal, place * float(normal @ self.directions[axis]), axis)
            for normal, (_, axis, place) in zip(normals, faces, strict=True)
        ]

    def _same(self, normal: np.ndarray, offset: float, axis: int, unevenness: float) -> np.ndarray:
        """(K,) bool: planes that are one face."""
        return (self.axis == axis) & (self.normal @ normal > 0) & (np.abs(self.offset - offset) < unevenness)

    def slopes(self, view: DepthView) -> np.ndarray:
        """(K, 3) vectors a of the planes: the inverse depth in a pixel is a . ray; 0 for planes that turn away."""
        behind = self.offset - self.normal @ view.camera.center  # negative where the camera is before the plane
        front = behind < -1e-6
        return np.where(front[:, None], self.normal / np.where(front, behind, -1.0)[:, None], 0.0)


@dataclass(frozen=True)
class _Patches:
    """Planes of superpixels: normal (P, 3) to the camera, centre (P, 3), deviation of points across it (P,), weight
    (P,), first and second moments (P, 3), (P, 3, 3) of weighted points, area (P,) and view (P,).
    """

    normal: np.ndarray
    center: np.ndarray
    deviation: np.ndarray
    weight: np.ndarray
    first: np.ndarray
    second: np.ndarray
    area: np.ndarray
    view: np.ndarray

    def on(self, n: np.ndarray, d: float) -> np.ndarray:
        """(P,) bool: patches that lie on a plane and face the same side."""
        square = np.einsum("pij,i,j->p", self.second, n, n) - 2 * d * (self.first @ n) + d * d * self.weight
        return (square < (_LIES * self.deviation) ** 2 * self.weight) & (self.normal @ n > _TURN)

    def shown(self, on: np.ndarray) -> np.ndarray:
        """(V,) square metres of chosen patches in each view."""
        return np.bincount(self.view[on], self.area[on])

    def offset_deviation(self, on: np.ndarray) -> float:
        """Deviation of the offset of the plane through chosen patches, metres."""
        return float(np.sqrt(1 / (1 / self.deviation[on] ** 2).sum()))


def find_room_planes(views: Sequence[DepthView], pieces: Sequence[Superpixels], noise: float) -> RoomPlanes:
    """Find the planes that several views show.

    Parameters
    ----------
    pieces
        Superpixels of each view.
    noise
        Deviation of depth at one metre, metres; that of inverse depth.
    """
    patches = _joined(
        [_patches(view, piece, noise, i) for i, (view, piece) in enumerate(zip(views, pieces, strict=True))]
    )
    planes = _grouped(patches)
    directions = sharpened(_directions(planes, patches, _mean_up(views)), views)
    return _described(_snapped(planes, patches, directions), patches, directions)


def _patches(view: DepthView, pieces: Superpixels, noise: float, number: int) -> _Patches:
    """Fit a plane to the known pixels of each superpixel: inverse depth is linear in the ray, its noise even."""
    known = view.map.known
    label, rays = pieces.label[known].astype(np.int64), view.rays[known]
    q, count = 1 / view.map.depth[known].astype(np.float64), pieces.count
    weight = view.map.confidence[known].astype(np.float64)
    use = np.ones(len(q), bool)
    slope = np.zeros((count, 3))
    for _ in range(_ROUNDS):
        w = weight * use
        matrix = np.stack([
            np.bincount(label, w * rays[:, i] * rays[:, j], count) for i in range(3) for j in range(3)
        ], axis=1).reshape(-1, 3, 3)  # fmt: skip
        right = np.stack([np.bincount(label, w * rays[:, i] * q, count) for i in range(3)], axis=1)
        ridge = 1e-9 * np.trace(matrix, axis1=1, axis2=2) + 1e-12
        slope = np.linalg.solve(matrix + ridge[:, None, None] * np.eye(3), right[..., None])[..., 0]
        off = np.abs((slope[label] * rays).sum(axis=1) - q)
        # the first plane may be turned by outliers: what is farther than most goes first
        spread = _median_of(off, label, count)
        use = off < np.maximum(WITHIN * noise, 2 * spread)[label]
    use = off < WITHIN * noise
    inside, total = np.bincount(label, use, count), np.bincount(label, minlength=count)
    good = (inside >= _LEAST) & (inside >= _FILLED * total) & (np.linalg.norm(slope, axis=1) > 1e-6)
    use &= good[label]
    label, rays, q = np.cumsum(good)[label[use]] - 1, rays[use], q[use]
    return _measured(view, slope[good], label, rays, q, noise, number)


def _median_of(values: np.ndarray, label: np.ndarray, count: int) -> np.ndarray:
    """(count,) median of the values of each label; 0 for none."""
    order = np.lexsort((values, label))
    size = np.bincount(label, minlength=count)
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    result = np.zeros(count)
    some = size > 0
    result[some] = values[order][(first + size // 2)[some]]
    return result


def _measured(
    view: DepthView, slope: np.ndarray, label: np.ndarray, rays: np.ndarray, q: np.ndarray, noise: float, number: int
) -> _Patches:
    """Patches of planes a (P, 3) and of their pixels' labels, rays and inverse depths."""
    count = len(slope)
    length = np.linalg.norm(slope, axis=1)
    normal = -slope / length[:, None]
    points = view.camera.center + rays / q[:, None]
    lean = np.maximum(-(rays * normal[label]).sum(axis=1), 1e-3)
    weight = 1 / (noise * lean / q**2) ** 2
    total = np.maximum(np.bincount(label, weight, count), 1e-30)
    first = np.stack([np.bincount(label, weight * points[:, i], count) for i in range(3)], axis=1)
    second = np.stack([
        np.bincount(label, weight * points[:, i] * points[:, j], count) for i in range(3) for j in range(3)
    ], axis=1).reshape(-1, 3, 3)  # fmt: skip
    area = np.bincount(label, 1 / (q**2 * view.camera.fx * view.camera.fy * lean), count)
    deviation = np.sqrt(np.bincount(label, minlength=count) / total)
    return _Patches(normal, first / total[:, None], deviation, total, first, second, area, np.full(count, number))


def _joined(patches: list[_Patches]) -> _Patches:
    return _Patches(*(np.concatenate([getattr(p, name) for p in patches]) for name in _Patches.__dataclass_fields__))


@dataclass(frozen=True)
class _Plane:
    """A plane, the (P,) bool patches that lie on it, and the room's direction that it is along, -1 for none."""

    normal: np.ndarray
    offset: float
    on: np.ndarray
    axis: int = -1


def _grouped(patches: _Patches) -> list[_Plane]:
    """Join patches that lie on one plane, beginning at the largest."""
    free = np.ones(len(patches.area), bool)
    found = []
    for seed in np.argsort(-patches.area)[:_MOST_SEEDS]:
        if not free[seed]:
            continue
        n, d = patches.normal[seed], float(patches.normal[seed] @ patches.center[seed])
        on = np.zeros(len(free), bool)
        for _ in range(_ROUNDS):
            on = free & patches.on(n, d)
            if not on.any():
                break
            n, d = _plane_of(patches, on, n)
        free[seed] = False
        area = patches.shown(on)
        if area.max(initial=0) < _SMALLEST or (area > 0).sum() < 2:
            continue
        free &= ~on
        found.append(_Plane(n, d, on))
    return found


def _plane_of(patches: _Patches, on: np.ndarray, like: np.ndarray) -> tuple[np.ndarray, float]:
    """Plane of least squares through the points of patches, turned like another."""
    total = patches.weight[on].sum()
    middle = patches.first[on].sum(axis=0) / total
    spread = patches.second[on].sum(axis=0) / total - np.outer(middle, middle)
    n = np.linalg.eigh(spread)[1][:, 0]
    n = n if n @ like > 0 else -n
    return n, float(n @ middle)


def _mean_up(views: Sequence[DepthView]) -> np.ndarray:
    """(3,) mean up of the cameras; zeros where they do not agree on one.

    Photographs in portrait have the pixels of the sensor: there it is its x axis that points up or down.
    """
    axes = np.mean([view.camera.world_from_camera[:3, :2] for view in views], axis=0).T
    up = axes[np.linalg.norm(axes, axis=1).argmax()]
    return up if np.linalg.norm(up) >= _LEAST_UP else np.zeros(3)


def _leading(normal: np.ndarray, shown: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(3, 3) directions that most surface of planes is along: the world's axes, unless others have clearly more.

    Others are those of two planes at right angles, or of one plane and a world axis. One of them is near the cameras'
    mean ``up`` (3,), if it is not zero, or no farther from it than the world's axes: cameras that look down from one
    side have a mean up off the vertical.
    """
    least = min(_UPRIGHT * float(np.linalg.norm(up)), _NO_FARTHER * float(np.abs(up).max()))
    best, most = np.eye(3), _CLEARLY * _along(np.eye(3), normal, shown)
    largest = normal[np.argsort(-shown, kind="stable")[:_LEADING]]
    for first, other in permutations([*np.eye(3), *largest], 2):
        second = other - (other @ first) * first
        length = np.linalg.norm(second)
        if length < _NEARLY:
            continue
        second /= length
        directions = np.array([first, second, np.cross(first, second)])
        if np.abs(directions @ up).max() < least:
            continue
        along = _along(directions, normal, shown)
        if along > most:
            best, most = directions, along
    # of the 24 ways to number the same directions, the one nearest to the world's axes
    return max((turn @ best for turn in cube_turns()), key=np.trace)


def _along(directions: np.ndarray, normal: np.ndarray, shown: np.ndarray) -> float:
    """Square metres that planes show which lie along one of the directions, nearly."""
    return float(shown[np.abs(normal @ directions.T).max(axis=1) > _NEARLY].sum())


def _directions(planes: Sequence[_Plane], patches: _Patches, up: np.ndarray) -> np.ndarray:
    """(3, 3) the room's directions: the world's axes or others, turned to the planes near them; ``up`` (3,)."""
    normal = np.array([plane.normal for plane in planes]).reshape(-1, 3)
    shown = np.array([patches.shown(plane.on).sum() for plane in planes])
    directions = _leading(normal, shown, up)
    for limit in (_NEARLY, _SNAP, _SNAP):
        cosine = normal @ directions.T
        axis = np.abs(cosine).argmax(axis=1) if len(planes) else np.zeros(0, np.int64)
        best = np.take_along_axis(cosine, axis[:, None], 1)[:, 0]
        near = np.abs(best) > limit
        target = np.eye(3)[axis[near]] * np.sign(best[near])[:, None]
        correlation = (normal[near] * shown[near, None]).T @ target
        # few planes leave turns open: the directions before hold these
        u, _, v = np.linalg.svd(correlation + 1e-3 * max(float(shown.sum()), 1e-3) * directions.T)
        turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
        directions = turn.T
    return directions


def _straight(plane: _Plane, patches: _Patches, directions: np.ndarray) -> _Plane:
    """The plane brought to the room's direction that it is near, unless it has a slope that the noise does not hide."""
    cosine = directions @ plane.normal
    axis = int(np.abs(cosine).argmax())
    if abs(cosine[axis]) <= _SNAP:
        return plane
    straight = np.sign(cosine[axis]) * directions[axis]
    middle = float(np.average(patches.center[plane.on] @ straight, weights=patches.weight[plane.on]))
    lies = np.median(patches.on(straight, middle)[plane.on])
    return _Plane(straight, middle, plane.on, axis) if lies else plane


def _snapped(planes: Sequence[_Plane], patches: _Patches, directions: np.ndarray) -> list[_Plane]:
    """Bring planes to the room's directions; join those of which most then lies on a larger one."""
    kept: list[_Plane] = []
    for plane in sorted(planes, key=lambda plane: -patches.shown(plane.on).max()):
        found = _straight(plane, patches, directions)
        for number, other in enumerate(kept):
            if np.median(patches.on(other.normal, other.offset)[found.on]):
                on = found.on | other.on
                both = _Plane(*_plane_of(patches, on, other.normal), on)
                kept[number] = _straight(both, patches, directions)
                break
        else:
            kept.append(found)
    return kept


def _described(planes: Sequence[_Plane], patches: _Patches, directions: np.ndarray) -> RoomPlanes:
    """The planes, and what is known of each."""
    area = [patches.shown(plane.on) for plane in planes]
    return RoomPlanes(
        normal=np.array([plane.normal for plane in planes]).reshape(-1, 3),
        offset=np.array([plane.offset for plane in planes]),
        sigma=np.array([patches.offset_deviation(plane.on) for plane in planes]),
        area=np.array([float(each.max()) for each in area]),
        views=np.array([(each > 0).sum() for each in area], np.int64),
        axis=np.array([plane.axis for plane in planes], np.int64),
        directions=directions,
    )
