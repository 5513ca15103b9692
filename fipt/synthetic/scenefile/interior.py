"""The inside of a modelled room: where it is, its box, its openings.

A point is *inside* if most rays from it meet a surface, and a floor and a ceiling are below and above it. The interior
is all such points of a grid that are connected, each to the next in a straight line, with the one where we begin: the
file's camera, or a place that it sees, or the most spacious point where none of these is inside. Walls further out,
backdrops and hollow furniture do not belong to it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.errors import FiptError
from fipt.groups import connected_groups
from fipt.render.scene import RayScene
from fipt.scene.environment import EnvironmentMap, solid_angles, texel_directions
from fipt.scene.mesh import Mesh

log = logging.getLogger(__name__)

ENCLOSED = 0.55
"""Share of rays that must meet a surface. In the plane of a missing wall it is about a half."""

_CELLS = 12_000
_DIRECTIONS = 48
_CONE = 0.85
"""Cosine of the directions, from where a camera looks, in which it is asked for free places."""
_EDGE_SAMPLES = 12
"""Fewest rays that must meet a wall for it to bound the box; otherwise the last point inside does."""

_ROUNDS = 4
_LEAVING = 120_000
"""Rays that look for openings, each time."""
_TIGHT = 2e-4
"""Share of leaving rays at which the room counts as closed."""
_LEAKY = 0.01
"""Largest share at which it is accepted in the end."""
_FEWEST = 12
"""Rays of an opening: fewer leave through cracks."""
_CELL = 0.08
_MOST_QUADS = 40
_DEPTHS = np.linspace(-0.1, 0.6, 36)
"""Where the narrowest place of an opening is looked for, metres outwards from the box."""
_MARGIN, _GRID = 0.02, 24
_SKY_SHAPE = (32, 64)
_PLACES = 3


@dataclass(frozen=True)
class Interior:
    """The inside of a room.

    Attributes
    ----------
    points
        (N, 3) float64 points of a grid.
    step
        Its spacing.
    box
        (2, 3) lower and upper corner of the interior.
    """

    points: np.ndarray
    step: float
    box: np.ndarray

    def scaled(self, factor: float) -> Interior:
        """Return the interior in another unit."""
        return Interior(self.points * factor, self.step * factor, self.box * factor)


@dataclass(frozen=True)
class Opening:
    """A quad that closes an opening.

    Attributes
    ----------
    corners
        (4, 3) float64, counter-clockwise as seen from inside.
    radiance
        (3,) mean radiance that comes in through it.
    """

    corners: np.ndarray
    radiance: np.ndarray


def find_interior(mesh: Mesh, scene: RayScene, cameras: Sequence[np.ndarray], where: str) -> Interior:
    """Find the interior of a room with y up.

    Parameters
    ----------
    mesh, scene
        All its surfaces, any unit; the same to trace rays against.
    cameras
        (4, 4) poses of the file's cameras, z ahead.
    where
        Names the scene in errors.

    Raises
    ------
    FiptError
        If no place has walls, floor and ceiling around it: the scene is outdoors.
    """
    start = _start(mesh, scene, cameras, where)
    low, high = _extent(scene, start)
    found = _grown(scene, start, low, high)  # coarsely in all that is seen, then finely in the box that is found
    margin = found.step + 0.05 * np.ptp(found.box, axis=0)
    low, high = np.minimum(found.box[0], start) - margin, np.maximum(found.box[1], start) + margin
    return _grown(scene, start, low, high)


def _grown(scene: RayScene, start: np.ndarray, low: np.ndarray, high: np.ndarray) -> Interior:
    """The interior around a point, as far as it lies between two corners."""
    step = float(np.prod(high - low) / _CELLS) ** (1 / 3)
    shape = np.maximum(np.round((high - low) / step).astype(int), 1)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    first = np.clip(np.floor((start - low) / step).astype(int), 0, shape - 1)
    points = start + (grid - first) * step  # the start is one of them
    inside = _enclosed(scene, points)[0] >= ENCLOSED
    number = np.ravel_multi_index(tuple(first), tuple(shape))
    inside[number] = True
    label = _connected(scene, points, inside, shape, step)
    chosen = inside & (label == label[number])
    box = _box(scene, points, chosen, shape, step)
    return Interior(points[chosen & ((points > box[0]) & (points < box[1])).all(axis=1)], step, box)


def _start(mesh: Mesh, scene: RayScene, cameras: Sequence[np.ndarray], where: str) -> np.ndarray:
    """(3,) a point inside: a camera's, or one ahead of it, or the most spacious one where none of these is inside."""
    for pose in cameras:
        start = _ahead(scene, pose)
        if start is not None:
            return start
    start = _most_spacious(mesh, scene, [pose[1, 3] for pose in cameras], where)
    if cameras:
        log.warning(
            "%s: no camera of the file stands in a room or sees into one; the room is that around (%s)",
            where,
            ", ".join(f"{value:.2f}" for value in start),
        )
    return start


def _ahead(scene: RayScene, pose: np.ndarray) -> np.ndarray | None:
    """(3,) a free place that a camera sees, its own first: they are never inside of things. None: none is inside."""
    ahead = np.concatenate([[(0.0, 0, 1)], _sphere(400)])
    ahead = (ahead[ahead[:, 2] > _CONE] @ pose[:3, :3].T) / np.linalg.norm(pose[:3, 2])
    place = np.repeat(pose[None, :3, 3], len(ahead), axis=0)
    reach = _trace(scene, place, ahead)[0]
    met = np.isfinite(reach)
    steps = np.array([0.1, 0.25, 0.5, 0.75])[:, None, None] * (reach[met, None] * ahead[met])
    options = np.concatenate([place[:1], (place[met] + steps).reshape(-1, 3)])
    share, _ = _enclosed(scene, options)
    best = 0 if share[0] >= ENCLOSED else int(np.argmax(share))
    return options[best] if share[best] >= ENCLOSED else None


def _most_spacious(mesh: Mesh, scene: RayScene, heights: Sequence[float], where: str) -> np.ndarray:
    """(3,) of a coarse grid, the place inside that has most space around it, at given heights where there are some."""
    centers, weights = mesh.corners.mean(axis=1), mesh.areas
    bounds = []
    for axis in centers.T:
        order = np.argsort(axis)
        total = np.cumsum(weights[order])
        bounds.append(axis[order][np.searchsorted(total, total[-1] * np.array([0.02, 0.98]))])
    low, high = np.transpose(bounds)
    marks = [np.linspace(a, b, n + 2)[1:-1] for a, b, n in zip(low, high, (12, 8, 12), strict=True)]
    if heights:  # of cameras: a solid that stands on the ground is no room
        marks[1] = np.unique(heights)
    options = np.stack(np.meshgrid(*marks), axis=-1).reshape(-1, 3).astype(np.float64)
    share, reach = _enclosed(scene, options)
    best = int(np.argmax(np.where(share >= ENCLOSED, reach, -1.0)))
    if share[best] < ENCLOSED:
        raise _outdoors(where, share.max())
    return options[best]


def _outdoors(where: str, share: float) -> FiptError:
    return FiptError(
        f"{where} has no interior: nowhere do {ENCLOSED:.0%} of all rays meet a surface, with a floor below and a "
        f"ceiling above (at best {share:.0%}); the scene is outdoors, or its walls are missing",
        "give a room with walls and a ceiling",
    )


def _enclosed(scene: RayScene, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) share of rays that meet a surface, 0 without floor or ceiling; (N,) median distance of what they meet."""
    directions = np.concatenate([_sphere(_DIRECTIONS), [(0, 1, 0), (0, -1, 0)]])
    count = len(directions)
    distance, _ = _trace(scene, np.repeat(points, count, axis=0), np.tile(directions, (len(points), 1)))
    distance = distance.reshape(-1, count)
    met = np.isfinite(distance)
    covered = met[:, -2:].all(axis=1)
    return met[:, :-2].mean(axis=1) * covered, np.median(np.where(met, distance, 0), axis=1)


def _trace(scene: RayScene, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances and triangles of (N, 3) rays; none at all are allowed."""
    if not len(origins):
        return np.zeros(0, np.float32), np.zeros(0, np.int32)
    return scene.intersect(origins.astype(np.float32), directions.astype(np.float32))


def _sphere(count: int) -> np.ndarray:
    """(count, 3) directions that spread evenly (Fibonacci's spiral).

    Not `fipt.render.directions.all_around`, which starts elsewhere: where openings are found hangs on it by decimetres.
    """
    k = np.arange(count) + 0.5
    phi, y = k * np.pi * (3 - 5**0.5), 1 - 2 * k / count
    side = np.sqrt(1 - y * y)
    return np.column_stack([side * np.cos(phi), y, side * np.sin(phi)])


def _extent(scene: RayScene, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of what is seen from a point, a few far things left out, and a little more."""
    directions = _sphere(4096)
    distance, _ = _trace(scene, np.repeat(start[None], len(directions), axis=0), directions)
    met = np.isfinite(distance)
    seen = start + distance[met, None] * directions[met]
    low, high = np.percentile(seen, (1, 99), axis=0)
    return low - 0.1 * (high - low), high + 0.1 * (high - low)


def _connected(scene: RayScene, points: np.ndarray, inside: np.ndarray, shape: np.ndarray, step: float) -> np.ndarray:
    """(N,) number of the component of each point; neighbours are joined where nothing stands between them."""
    index = np.arange(len(points)).reshape(shape)
    rows, columns = [], []
    for axis in range(3):
        a = np.delete(index, -1, axis).ravel()
        b = np.delete(index, 0, axis).ravel()
        both = inside[a] & inside[b]
        a, b = a[both], b[both]
        along = np.repeat(np.eye(3)[axis][None], len(a), axis=0)
        # From both ends: a point that lies on a surface does not see it.
        free = np.minimum(_trace(scene, points[a], along)[0], _trace(scene, points[b], -along)[0]) > 1.001 * step
        rows.append(a[free])
        columns.append(b[free])
    a, b = np.concatenate(rows), np.concatenate(columns)
    return connected_groups((a, b), len(points))


def _box(scene: RayScene, points: np.ndarray, chosen: np.ndarray, shape: np.ndarray, step: float) -> np.ndarray:
    """(2, 3) box: on each side where rays from the outermost points meet walls, else half a step beyond them."""
    box = np.zeros((2, 3))
    cells = chosen.reshape(shape)
    for axis in range(3):
        for side, sign in enumerate((-1, 1)):
            beyond = np.roll(cells, -sign, axis)
            edge: list[slice | int] = [slice(None)] * 3
            edge[axis] = -1 if sign > 0 else 0
            beyond[tuple(edge)] = False
            last = points[(cells & ~beyond).ravel()]
            distance, _ = _trace(scene, last, np.repeat(sign * np.eye(3)[axis][None], len(last), axis=0))
            near = distance < 1.5 * step
            walls = last[near, axis] + sign * distance[near]
            ends = points[chosen][:, axis]
            outermost = sign * (sign * ends).max() + sign * 0.5 * step
            # Furniture stops rays too: of what stops them, the outermost few per cent are the wall.
            found = np.percentile(walls, 97 if sign > 0 else 3) if len(walls) >= _EDGE_SAMPLES else outermost
            box[side, axis] = found
    return box


# --- openings -----------------------------------------------------------------------------------------------


def close_openings(
    scene: RayScene, interior: Interior, outside: EnvironmentMap, where: str
) -> tuple[list[Opening], float]:
    """Find quads, parallel to the sides of the interior's box, that close all its openings.

    Rays leave the room from everywhere inside and in all directions. Those that meet nothing cross the box's sides;
    connected patches of crossings are openings, and each is closed where its bundle of rays is narrowest.

    Parameters
    ----------
    scene, interior
        The room, metres.
    outside
        What shines through the openings.
    where
        Names the scene in errors.

    Returns
    -------
    openings
        The quads.
    leaving
        Share of rays that leave the room nevertheless.

    Raises
    ------
    FiptError
        If the room has too many openings, or stays open.
    """
    rng = np.random.default_rng(0)
    found: list[Opening] = []
    sky = _coarse(outside)
    points = interior.points
    share = 1.0
    for _ in range(_ROUNDS):
        origins, directions = _leaving(scene, points, rng)
        for opening in found:
            past = ~_stopped(origins, directions, opening.corners)
            origins, directions = origins[past], directions[past]
        share = len(origins) / _LEAVING
        quads = _quads(scene, origins, directions, interior.box) if share >= _TIGHT else []
        if not quads or len(found) > _MOST_QUADS:
            break
        for corners in quads:
            found.append(Opening(corners, _incoming(scene, corners, sky)))
            points = points[~_behind(points, corners)]
    if share > _LEAKY or len(found) > _MOST_QUADS:
        raise FiptError(
            f"{where}: light comes in through more than a few openings ({len(found)} quads still let {share:.1%} of "
            "the rays out)",
            "set environment: keep, or close the room",
        )
    return found, share


def _behind(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(N,) bool: points in the recess that a quad closes."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis = int(np.argmin(high - low))
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    across = np.arange(3) != axis
    within = ((points > low) & (points < high))[:, across].all(axis=1)
    return within & ((points - corners[0]) @ normal <= 0)


def _stopped(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(N,) bool: rays that cross a quad."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis = int(np.argmin(high - low))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (low[axis] - origins[:, axis]) / directions[:, axis]
        points = origins + distance[:, None] * directions
    across = np.arange(3) != axis
    return (distance > 0) & ((points >= low) & (points <= high))[:, across].all(axis=1)


def _leaving(scene: RayScene, points: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (N, 3) of those of `_LEAVING` random rays that meet nothing."""
    origins = points[rng.integers(len(points), size=_LEAVING)]
    directions = rng.standard_normal((_LEAVING, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _, triangle = _trace(scene, origins, directions)
    return origins[triangle < 0], directions[triangle < 0]


def _quads(scene: RayScene, origins: np.ndarray, directions: np.ndarray, box: np.ndarray) -> list[np.ndarray]:
    """(4, 3) corners of a quad for every connected patch where rays cross the box's sides."""
    from scipy.ndimage import binary_dilation, label

    towards = np.where(directions > 0, box[1], box[0])
    with np.errstate(divide="ignore"):
        distance = np.where(directions != 0, (towards - origins) / directions, np.inf)
    axis = distance.argmin(axis=1)
    made = []
    for k in range(3):
        others = [n for n in range(3) if n != k]
        for sign in (-1, 1):
            mine = (axis == k) & (np.sign(directions[:, k]) == sign)
            if not mine.any():
                continue
            o, d = origins[mine], directions[mine]
            points = (o + distance[mine, k][:, None] * d)[:, others]
            cell = np.floor((points - box[0, others]) / _CELL).astype(int)
            cell -= cell.min(axis=0)
            mask = np.zeros(tuple(cell.max(axis=0) + 1), bool)
            mask[tuple(cell.T)] = True
            # The bars of a window separate its panes by less than two cells.
            bundle_of = np.zeros(mask.shape, np.int32)
            label(binary_dilation(mask, np.ones((3, 3))), np.ones((3, 3)), output=bundle_of)
            number = bundle_of[tuple(cell.T)]
            plane = box[1 if sign > 0 else 0, k]
            bundles = [number == n for n in range(1, number.max() + 1)]
            made += [_quad(scene, o[b], d[b], k, sign, plane) for b in bundles if b.sum() >= _FEWEST]
    return made


def _quad(
    scene: RayScene, origins: np.ndarray, directions: np.ndarray, axis: int, sign: int, plane: float
) -> np.ndarray:
    """(4, 3) corners, counter-clockwise from inside, of a quad that a bundle of rays crosses.

    It lies where the bundle is narrowest or further outside: where least stands right behind it, so that the bars of
    a window and the wall around an arch are in front.
    """
    others = [n for n in range(3) if n != axis]

    def crossings(depth: float) -> np.ndarray:
        along = (plane + sign * depth - origins[:, axis]) / directions[:, axis]
        return origins[:, others] + np.maximum(along, 0)[:, None] * directions[:, others]

    def at(points: np.ndarray, depth: float) -> np.ndarray:
        return np.insert(points, axis, plane + sign * depth, axis=1)

    def covered(depth: float) -> int:
        """Count the points of a grid over the quad with something right behind."""
        points = crossings(depth)
        share = (np.mgrid[:_GRID, :_GRID].reshape(2, -1).T + 0.5) / _GRID
        places = at(points.min(axis=0) + share * np.ptp(points, axis=0), depth)
        outwards = np.repeat(sign * np.eye(3)[axis][None], len(places), axis=0)
        return int((_trace(scene, places, outwards)[0] < _DEPTHS[-1]).sum())

    sizes = [np.prod(np.ptp(np.percentile(crossings(depth), (1, 99), axis=0), axis=0)) for depth in _DEPTHS]
    options = _DEPTHS[int(np.argmin(sizes)) :]
    depth = options[int(np.argmin([covered(depth) for depth in options]))]
    points = crossings(depth)
    (u0, v0), (u1, v1) = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    corners = at(np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)]), depth)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])[axis]
    return corners if normal * sign < 0 else corners[::-1]


def _incoming(scene: RayScene, corners: np.ndarray, sky: np.ndarray) -> np.ndarray:
    """(3,) radiance of a quad that lets in as much light as comes through it from outside.

    The mean over directions into the room, weighted by their cosine, of the radiance from outside (`_coarse`) where
    nothing stands in its way.
    """
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal /= np.linalg.norm(normal)
    directions = texel_directions(*_SKY_SHAPE)
    weight = np.repeat(solid_angles(*_SKY_SHAPE), _SKY_SHAPE[1], axis=1).ravel() * -(directions @ normal)
    directions, radiance, weight = directions[weight > 0], sky[weight > 0], weight[weight > 0]
    u, v = (np.mgrid[:_PLACES, :_PLACES].reshape(2, -1, 1) + 0.5) / _PLACES
    places = corners[0] + u * (corners[1] - corners[0]) + v * (corners[3] - corners[0]) - 1e-3 * normal
    _, triangle = _trace(scene, np.repeat(places, len(directions), axis=0), np.tile(directions, (len(places), 1)))
    seen = (triangle < 0).reshape(len(places), -1).mean(axis=0)
    return (radiance * (weight * seen)[:, None]).sum(axis=0) / weight.sum()


def _coarse(outside: EnvironmentMap) -> np.ndarray:
    """(32 * 64, 3) mean radiance around the texels of a coarse map, the sun's included."""
    rows, columns = outside.radiance.shape[:2]
    if rows > _SKY_SHAPE[0]:
        down, across = (np.linspace(0, n, k + 1).astype(int) for n, k in zip((rows, columns), _SKY_SHAPE, strict=True))
        total = np.add.reduceat(np.add.reduceat(outside.radiance.astype(np.float64), down[:-1], 0), across[:-1], 1)
        mean = total / (np.diff(down)[:, None] * np.diff(across))[..., None]
        outside = replace(outside, radiance=mean.astype(np.float32))
    return outside.lookup(texel_directions(*_SKY_SHAPE))
