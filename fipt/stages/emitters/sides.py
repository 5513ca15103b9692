"""Which sides of an emitter shine: those that views see, and see shine (ADR 74).

A *face* is what one could paint without crossing a rim: sides of triangles, joined across edges. A pane has two, a
globe its outside and its inside. The winding of a triangle says which of its sides is the front. It may change within
an emitter: then a face passes from the front of a triangle to the back of its neighbour.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups, grouped_median
from fipt.render.directions import cosine_directions
from fipt.render.scene import RayScene
from fipt.scene.emitters import BACK, FRONT, Emitters
from fipt.scene.mesh import Mesh, points_of
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE

LEAST_SEEN = 0.05
"""Share of a sheet's seen area that must be seen of a face: noise of scans turns 1 to 2 % of the triangles."""
_EMITS = 0.5
"""Radiance, as a share of the emitter's, above which a face is nearer to it than to black."""
_RAYS = 2048
"""From the inside of an emitter: the share that leaves is then known within 1 %."""
_HOLE = (0.02, 0.4)
"""Share of the rays from an inside that leave through its hole: of a globe, what it lacks of itself. Of an open
cylinder as high as wide it is 0.41, and its inside may be dark."""
_FOLDED = -0.9
"""Cosine between normals beyond which a sheet is folded onto itself: panes back to back share their rims."""


def emitting_sides(mesh: Mesh, found: Emitters, shards: Sequence[ObservedShard]) -> np.ndarray:
    """(E,) int8 sides of the emitting triangles that shine; those of unseen pieces follow the nearest seen ones.

    Parameters
    ----------
    found
        Emitters of which each has a pixel that shows it.
    shards
        The training views.
    """
    face = faces(mesh, found.triangle, found.emitter)
    other = np.empty(int(face.max(initial=-1)) + 1, np.int64)  # the face behind each
    other[face] = face[:, ::-1]
    area, ratio = _seen(mesh, found, shards, face, other)
    visible = (area > 0) & (area >= LEAST_SEEN * (area + area[other]))
    ratio = np.where(visible, ratio, -np.inf)
    emitting = _with_unseen(mesh, found, face, visible & ((ratio >= _EMITS) | (ratio >= ratio[other])))
    emitting[face] |= _inside(mesh, found, (emitting[other] & ~emitting & ~visible)[face])
    return (emitting[face] @ [FRONT, BACK]).astype(np.int8)


def _inside(mesh: Mesh, found: Emitters, unseen: np.ndarray) -> np.ndarray:
    """(E, 2) bool: of ``unseen`` sides (E, 2) those of emitters that are closed but for a hole.

    The inside of a globe shines like its outside: what leaves through the hole is what the piece that a scan lacks
    would send out.
    """
    numbers, result = _nearly_closed(mesh, found, unseen), np.zeros_like(unseen)
    if len(numbers) == 0:
        return result
    scene, rng = RayScene(mesh), np.random.default_rng(0)
    areas = mesh.areas[found.triangle]
    for number in numbers:
        own = unseen & (found.emitter == number)[:, None]
        row, side = np.nonzero(own)
        pick = rng.choice(len(row), _RAYS, p=areas[row] / areas[row].sum())
        triangle, turn = found.triangle[row[pick]], np.where(side[pick] == 0, 1, -1)[:, None]
        normal = (scene.normals[triangle] * turn).astype(np.float32)
        corners = mesh.vertices[mesh.triangles[triangle]]
        point = points_of(corners, *rng.random((2, _RAYS))) + scene.epsilon * normal
        direction = cosine_directions(normal, rng)
        distance, _ = scene.intersect(point.astype(np.float32), direction)
        end = point + np.minimum(distance, 1e3 * scene.extent)[:, None] * direction
        low, high = corners.min(axis=(0, 1)) - 2 * scene.epsilon, corners.max(axis=(0, 1)) + 2 * scene.epsilon
        leaves = ((end < low) | (end > high)).any(axis=1).mean()
        result |= own & (_HOLE[0] < leaves < _HOLE[1])
    return result


def _nearly_closed(mesh: Mesh, found: Emitters, unseen: np.ndarray) -> np.ndarray:
    """(K,) numbers of the emitters with ``unseen`` sides (E, 2) whose holes may be small enough; no ray is traced.

    The vectors of area of a closed surface cancel; what is left is no more than the area of its holes.
    """
    row, side = np.nonzero(unseen)
    vectors = np.where(side == 0, 1, -1)[:, None] * mesh.area_normals[found.triangle[row]]
    of, area = found.emitter[row], mesh.areas[found.triangle[row]]
    left = np.linalg.norm(np.stack([np.bincount(of, column) for column in vectors.T], axis=1), axis=1)
    return np.unique(of[(left < _HOLE[1] * np.bincount(of, area))[of]])


def faces(mesh: Mesh, triangles: np.ndarray, emitter: np.ndarray) -> np.ndarray:
    """(E, 2) int64 number of the face that front and back of each of these triangles (E,) belong to.

    Edges of more than two triangles end a face, and so does the end of an emitter; ``emitter`` (E,) has their numbers.
    """
    _, corner = np.unique(mesh.corners[triangles].reshape(-1, 3), axis=0, return_inverse=True)
    ends = corner.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    first, second = order[count[edge[order]] == 2].reshape(-1, 2).T
    a, b = first // 3, second // 3
    against = (ends[first] == ends[second]).all(axis=1)  # neighbours of one winding run along their edge in turn
    normal = mesh.normals[triangles]
    flat = np.where(against, -1, 1) * (normal[a] * normal[b]).sum(axis=1) > _FOLDED
    joined = flat & (emitter[a] == emitter[b])
    a, b, against = a[joined], b[joined], against[joined].astype(np.int64)
    sides = np.concatenate([[2 * a, 2 * b + against], [2 * a + 1, 2 * b + 1 - against]], axis=1)
    return connected_groups(sides, 2 * len(triangles)).reshape(-1, 2)


def seen_sides(
    mesh: Mesh, shards: Sequence[ObservedShard], chosen: np.ndarray, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2) bool whether pixels show front and back of ``chosen`` triangles (T,) alone, and whether that is bright.

    ``level`` (T,) is the radiance of the emitter that a triangle belongs to; bright is half of it. A clipped pixel may
    be as bright.
    """
    count, total = np.zeros((2, len(mesh.triangles), 2))
    for place, weight, _, light, clipped in _pixels(mesh, shards, chosen):
        alone = weight >= ALONE
        own = place[0][alone], place[1][alone]
        np.add.at(count, own, 1)
        np.add.at(total, own, np.where(clipped, np.maximum(light, level[place[0]]), light)[alone])
    return count > 0, (count > 0) & (total >= _EMITS * level[:, None] * count)


def _pixels(
    mesh: Mesh, shards: Sequence[ObservedShard], chosen: np.ndarray
) -> Iterator[tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield what the pixels of every view show of ``chosen`` triangles (T,) bool.

    That is triangle and side (0 front, 1 back) of each, its share of the pixel, the pixel's width (metres), its light
    (mean radiance of the channels), and whether that is only a lower bound: (N,) each.
    """
    for shard, index in [(each, index) for each in shards for index in range(len(each.samples.views))]:
        samples, own = shard.samples, shard.samples.of_view(index)
        pixel = samples.pixel_of_sample(index) + samples.pixels(index).start
        use = np.flatnonzero(chosen[samples.triangle[own]] & (shard.weight[pixel] > 0))
        triangle, shown = np.asarray(samples.triangle[own])[use], pixel[use]
        place = triangle, np.where(mesh.front(triangle, samples.normal[own][use]), 0, 1)
        width = samples.footprint[own][use].astype(np.float64)
        light = shard.radiance[shown].mean(axis=1)
        yield place, samples.weight[own][use], width, light, shard.clipped[shown]


def _seen(
    mesh: Mesh, found: Emitters, shards: Sequence[ObservedShard], face: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F,) square metres that are seen of each face, and its radiance as a share of the emitter's.

    Pixels count as large as they are across the ray: at a grazing angle the sides of a noisy surface are hardly told
    apart. A clipped pixel shows a lower bound: it may be as bright as the emitter.
    """
    row = np.full(len(mesh.triangles), -1)
    row[found.triangle] = np.arange(len(found.triangle))
    area, shares = np.zeros(face.shape), [(np.empty(0, np.int64), np.empty(0, np.float32), np.empty(0))]
    for (triangle, side), weight, width, light, clipped in _pixels(mesh, shards, row >= 0):
        place = row[triangle], side
        np.add.at(area, place, weight * width**2)
        light = light / np.maximum(found.radiance[place[0]].mean(axis=1), 1e-12)
        shares.append((face[place], weight, np.where(clipped, np.maximum(light, 1), light)))
    area = np.minimum(area, mesh.areas[found.triangle, None])
    of, weight, light = map(np.concatenate, zip(*shares, strict=True))
    return np.bincount(face.ravel(), area.ravel(), len(other)), _ratio(of, weight, light, other)


def _ratio(of: np.ndarray, weight: np.ndarray, light: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(F,) light of each face: the median of the pixels that it fills.

    One that fills none has the mean of its pixels by their shares. Where the face behind fills none either it is 1:
    what is seen behind slats was found to emit.

    Parameters
    ----------
    of, weight, light
        (N,) face that a pixel shows, its share of the pixel, and the pixel's light.
    other
        (F,) the face behind each.
    """
    ratio = np.bincount(of, weight * light, len(other)) / np.maximum(np.bincount(of, weight, len(other)), 1e-12)
    alone = weight >= ALONE
    filled, index = np.unique(of[alone], return_inverse=True)
    ratio[filled] = grouped_median(light[alone], index.reshape(-1), len(filled))
    fills = np.zeros(len(other), bool)
    fills[filled] = True
    return np.where(fills | fills[other], ratio, 1.0)


def _with_unseen(mesh: Mesh, found: Emitters, face: np.ndarray, bright: np.ndarray) -> np.ndarray:
    """(F,) bool which faces shine, also of pieces of which neither is ``bright`` (F,).

    Each triangle of such a piece is for the sides of the nearest one of its emitter that has some; the larger area
    decides for all. An emitter of which nothing is known shines to both sides.
    """
    sides, emitting = bright[face], bright.copy()
    seen = sides.any(axis=1)
    known = np.isin(found.emitter, found.emitter[seen])
    emitting[face[~known]] = True
    unseen, seen = np.flatnonzero(known & ~seen), np.flatnonzero(seen)
    if len(unseen) == 0:
        return emitting
    centers, normal = mesh.corners[found.triangle].mean(axis=1), mesh.normals[found.triangle]
    far = 4 * float(np.ptp(mesh.vertices, axis=0).max() + 1)
    place = np.concatenate([centers, found.emitter[:, None] * far], axis=1)
    nearest = seen[cKDTree(place[seen]).query(place[unseen])[1]]
    turned = (normal[unseen] * normal[nearest]).sum(axis=1) < 0
    wanted = np.where(turned[:, None], sides[nearest, ::-1], sides[nearest])
    votes = np.where(wanted, 1, -1) * mesh.areas[found.triangle[unseen], None]
    piece = face[unseen]
    emitting[piece] = np.bincount(piece.ravel(), votes.ravel(), len(bright))[piece] >= 0
    return emitting
