"""Which sides of an emitter shine: those that views see, and see shine (ADR 74).

A *face* is what one could paint without crossing a rim: sides of triangles, joined across edges. A pane has two, a
globe its outside and its inside. The winding of a triangle says which of its sides is the front. It may change within
an emitter: then a face passes from the front of a triangle to the back of its neighbour.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.stages.emitters.observations import grouped_median

_LEAST = 0.05
"""Share of a sheet's seen area that must be seen of a face: noise of scans turns 1 to 2 % of the triangles."""
_EMITS = 0.5
"""Radiance, as a share of the emitter's, above which a face is nearer to it than to black."""
_FOLDED = -0.9
"""Cosine between normals beyond which a sheet is folded onto itself: panes back to back share their rims."""
_TURNED = np.array([0, BACK, FRONT, BOTH], np.int8)
"""Sides -> the same sides of a triangle that is wound the other way."""


def emitting_sides(mesh: Mesh, found: Emitters, shards: Sequence[ObservedShard]) -> np.ndarray:
    """(E,) int8 sides of the emitting triangles that shine; those of unseen pieces follow the nearest seen ones.

    Parameters
    ----------
    found
        Emitters of which each has a pixel that shows it.
    shards
        The training views.
    """
    face = faces(mesh, found.triangle)
    area, ratio = _seen(mesh, found, shards, face)
    other = np.empty(len(area), np.int64)  # the face behind each
    other[face] = face[:, ::-1]
    visible = (area > 0) & (area >= _LEAST * (area + area[other]))
    ratio = np.where(visible, ratio, -np.inf)
    bright = (visible & ((ratio >= _EMITS) | (ratio >= ratio[other])))[face]
    return _with_unseen(mesh, found, (bright @ [FRONT, BACK]).astype(np.int8))


def faces(mesh: Mesh, triangles: np.ndarray) -> np.ndarray:
    """(E, 2) int64 number of the face that front and back of each of these triangles (E,) belong to.

    Edges of more than two triangles end a face.
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
    a, b, against = a[flat], b[flat], against[flat].astype(np.int64)
    sides = np.concatenate([[2 * a, 2 * b + against], [2 * a + 1, 2 * b + 1 - against]], axis=1)
    graph = coo_matrix((np.ones(sides.shape[1]), tuple(sides)), shape=(2 * len(triangles),) * 2)
    return connected_components(graph, directed=False)[1].reshape(-1, 2).astype(np.int64)


def _seen(
    mesh: Mesh, found: Emitters, shards: Sequence[ObservedShard], face: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F,) square metres that are seen of each face, and its median radiance as a share of the emitter's.

    Where a face fills no pixel its share is 1: what is seen behind slats was found to emit. Pixels count as large as
    they are across the ray: at a grazing angle the sides of a noisy surface are hardly told apart.
    """
    row = np.full(len(mesh.triangles), -1)
    row[found.triangle] = np.arange(len(found.triangle))
    count = int(face.max(initial=-1)) + 1
    area, shares = np.zeros(face.shape), [(np.empty(0, np.int64), np.empty(0))]
    for shard, index in [(each, index) for each in shards for index in range(len(each.samples.views))]:
        samples, own = shard.samples, shard.samples.of_view(index)
        pixel = samples.pixel_of_sample(index) + samples.pixels(index).start
        use = np.flatnonzero((row[samples.triangle[own]] >= 0) & (shard.weight[pixel] > 0))
        triangle, weight = samples.triangle[own][use], samples.weight[own][use]
        place = row[triangle], np.where(mesh.front(triangle, samples.normal[own][use]), 0, 1)
        np.add.at(area, place, weight * samples.footprint[own][use].astype(np.float64) ** 2)
        light = shard.radiance[pixel[use]].mean(axis=1) / np.maximum(found.radiance[place[0]].mean(axis=1), 1e-12)
        shares.append((face[place][weight >= ALONE], light[weight >= ALONE]))
    area = np.minimum(area, mesh.areas[found.triangle, None])
    ratio = np.ones(count)
    of, light = map(np.concatenate, zip(*shares, strict=True))
    known, index = np.unique(of, return_inverse=True)
    ratio[known] = grouped_median(light, index.reshape(-1), len(known))
    return np.bincount(face.ravel(), area.ravel(), count), ratio


def _with_unseen(mesh: Mesh, found: Emitters, sides: np.ndarray) -> np.ndarray:
    """The sides (E,) int8; a triangle of none shines to where the nearest of its emitter that has some does.

    Where nothing is known of any, all shine to both sides.
    """
    centers, normal = mesh.corners[found.triangle].mean(axis=1), mesh.normals[found.triangle]
    far = 4 * float(np.ptp(mesh.vertices, axis=0).max() + 1)
    place = np.concatenate([centers, found.emitter[:, None] * far], axis=1)
    unseen, seen = np.flatnonzero(sides == 0), np.flatnonzero(sides)
    if len(unseen) == 0:
        return sides
    if len(seen) == 0:
        return np.full_like(sides, BOTH)
    nearest = seen[cKDTree(place[seen]).query(place[unseen])[1]]
    turned = (normal[unseen] * normal[nearest]).sum(axis=1) < 0
    result = sides.copy()
    result[unseen] = np.where(turned, _TURNED[sides[nearest]], sides[nearest])
    return result
