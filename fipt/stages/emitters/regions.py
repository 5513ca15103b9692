"""Regions of the surface that look alike: the unit that is decided about.

Radiance is fused on the mesh: a triangle has the median of all pixels that show it, over all views. One that few
pixels show, because it is smaller than they are, borrows from the pixels around it on the same connected surface, no
farther than a pixel is wide. So the size of triangles does not matter.

Neighbouring triangles then become one region where the step between them is small against the steps inside of both
(Felzenszwalb and Huttenlocher 2004): d <= min over both of max(largest step inside, _STEP) + _NOISE / pixels. A soft
gradient stays one region, an edge of radiance that several views agree on ends it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import grouped_median
from fipt.scene.mesh import Mesh, connected_parts, touching_triangles
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.observations import Observations

PIXELS = 9
"""Pixels that a triangle's median needs: with fewer one or two mixed ones shift it."""
ALIKE = 0.5
"""Least cosine between normals of surface that lends radiance: a side face does not take that of the front."""
_STEP = 0.03
"""Steps of log radiance that are never an edge: about what is left of noise in a median of `PIXELS` pixels."""
_NOISE = 0.3
"""Steps of log radiance that one pixel alone does not tell from none: three times the spread in a triangle (0.1)."""
_DARK = 0.05
"""Share of the room's median radiance that is added before logarithms: below, only noise differs."""


@dataclass(frozen=True)
class Surface:
    """What the training views together show of T triangles.

    Attributes
    ----------
    radiance
        (T, 3) median, NaN where no pixel is near.
    pixels
        (T,) int64 pixels that show the triangle alone.
    width
        (T,) width of a pixel there, metres; 0 where no pixel is near.
    part
        (T,) connected part of the mesh.
    region
        (T,) int64 region, -1 where the radiance is not known.
    touching
        (2, N) pairs of regions that share an edge.
    dark
        Radiance below which differences do not count.
    """

    radiance: np.ndarray
    pixels: np.ndarray
    width: np.ndarray
    part: np.ndarray
    region: np.ndarray
    touching: np.ndarray
    dark: float

    @property
    def count(self) -> int:
        """Number of regions."""
        return int(self.region.max(initial=-1)) + 1


def find_regions(mesh: Mesh, shards: Sequence[ObservedShard], seen: Observations) -> Surface:
    """Fuse the radiance of all views on the mesh, and join triangles that look alike to regions."""
    part = connected_parts(mesh)
    radiance, width = _fused(mesh, shards, seen, part)
    pixels = np.bincount(seen.triangle, minlength=len(part))
    dark = _DARK * float(np.median(seen.radiance.mean(axis=1))) if len(seen.triangle) else 1.0
    pairs = touching_triangles(mesh)
    first = _merged(np.log(radiance + max(dark, 1e-9)), pixels, pairs)
    known = np.isfinite(radiance[:, 0])
    region = np.full(len(part), -1, np.int64)
    region[known] = np.unique(first[known], return_inverse=True)[1].reshape(-1)
    touching = region[pairs]
    touching = np.unique(touching[:, (touching >= 0).all(axis=0) & (touching[0] != touching[1])], axis=1)
    return Surface(radiance, pixels, width, part, region, touching, dark)


def rows_of(shards: Sequence[ObservedShard], seen: Observations, name: str) -> np.ndarray:
    """(N, ...) array ``name`` of the samples that are seen."""
    result, view, done = [], 0, 0
    for shard in shards:
        view += len(shard.samples.views)
        end = int(np.searchsorted(seen.view, view))
        result.append(np.asarray(getattr(shard.samples, name)[seen.sample[done:end]]))
        done = end
    return np.concatenate(result)


def by_part(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N, 4) points with their connected part as a coordinate so far apart that none is near another's."""
    far = 4 * float(np.ptp(points, axis=0).max(initial=0) + 1)
    return np.concatenate([points, part[:, None] * far], axis=1)


def _fused(
    mesh: Mesh, shards: Sequence[ObservedShard], seen: Observations, part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (T, 3) and width of a pixel (T,) of every triangle."""
    radiance, width = np.full((len(part), 3), np.nan), np.zeros(len(part))
    if len(seen.triangle) == 0:
        return radiance, width
    shown, index = np.unique(seen.triangle, return_inverse=True)
    footprint = rows_of(shards, seen, "footprint").astype(np.float64)
    radiance[shown] = grouped_median(seen.radiance, index.reshape(-1), len(shown))
    width[shown] = grouped_median(footprint, index.reshape(-1), len(shown))
    few = np.flatnonzero(np.bincount(seen.triangle, minlength=len(part)) < PIXELS)
    places = by_part(np.concatenate([rows_of(shards, seen, "position"), mesh.corners[few].mean(axis=1)]),
                     np.concatenate([part[seen.triangle], part[few]]))  # fmt: skip
    pixels = len(seen.triangle)
    nearest = range(1, min(PIXELS, pixels) + 1)
    distance, near = cKDTree(places[:pixels]).query(places[pixels:], k=nearest, workers=-1)
    own = np.sqrt(mesh.areas[few])[:, None]
    facing = np.abs((mesh.normals[few][:, None] * rows_of(shards, seen, "normal")[near]).sum(axis=-1))
    lends = (distance <= footprint[near] + own / 2) & (facing > ALIKE)
    row = np.repeat(np.arange(len(few)), lends.sum(axis=1))
    found, index = np.unique(row, return_inverse=True)
    radiance[few[found]] = grouped_median(seen.radiance[near[lends]], index.reshape(-1), len(found))
    width[few[found]] = grouped_median(footprint[near[lends]], index.reshape(-1), len(found))
    return radiance, width


def _merged(level: np.ndarray, pixels: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(T,) a triangle that stands for the region of each; ``level`` is (T, 3) log radiance."""
    step = np.abs(level[pairs[0]] - level[pairs[1]]).max(axis=1)
    known = np.isfinite(step)
    order = np.argsort(step[known], kind="stable")
    a, b, steps = (values[known][order].tolist() for values in (*pairs, step))
    parent, size = list(range(len(level))), np.maximum(pixels, 0.25).tolist()
    inside = [_STEP] * len(level)

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    for x, y, edge in zip(a, b, steps, strict=True):
        x, y = root(x), root(y)
        if x == y or edge > min(inside[x] + _NOISE / size[x], inside[y] + _NOISE / size[y]):
            continue
        if size[x] < size[y]:
            x, y = y, x
        parent[y], size[x], inside[x] = x, size[x] + size[y], max(inside[x], inside[y], edge)
    return np.array([root(node) for node in range(len(level))], np.int64)
