"""Pieces of seen surface that tell of the light: what they send back, and what is known of reflectances beforehand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.scene.voxels import facings, voxel_keys

MIDDLE, MIDDLE_SPREAD = np.log(0.4), 0.3
"""Mean log reflectance of a room and how much rooms differ: those of development have 0.32 to 0.45."""
WITHIN = 0.6
"""Standard deviation of the log reflectances of a room's surfaces; of those rooms 0.62."""
WHITE, ABOVE = np.log(0.9), 0.1
"""No paint reflects more than 0.9; relative error of the light above which a brighter one is not believed."""
FREEDOM = 4.0
"""Degrees of freedom of the residuals (Student): edges, highlights and textures are outliers."""
LEAST_SIGMA = 0.05
"""Least relative error of what was traced: 512 rays a block."""
GLOSSY = 0.3
"""Standard deviation of the log radiance between views above which a block is not matte."""
_GRIDS = (16, 24, 32, 48, 64, 96, 128)
"""Blocks along the scene box: the coarsest grid that has as many blocks as are wanted."""
LEAST_BLOCKS = 30
"""Pieces of seen surface without which no light is told from a reflectance."""
MANY_BLOCKS = 1000
"""Blocks whose light is traced: it is a smooth function of place, and has few unknowns."""
_PLANES = 64
"""Planes along the box that are told apart: some 10 cm in a room, the depth of a shelf."""
_LARGE = 0.01
"""Share of all blocks that a plane has which goes on where no view looks: a wall, not the side of a drawer."""
_BESIDE = 4
"""Nearest blocks whose mean tells how bright a plane is where it goes on."""
_SCANNED = 0.25
"""Share of all samples that a part has only if it is no single thing."""
_LEAST_PIXELS = 4
"""Pixels that a block needs for a mean."""
_REFLECTING = 0.995
"""Share of the blocks whose pixels are taken to show no lamp."""


@dataclass(frozen=True)
class Blocks:
    """N pieces of seen surface, each of one connected part that faces one way.

    Attributes
    ----------
    position, normal
        (N, R, 3) float32: R samples of each, with repeats.
    radiance
        (N, 3) geometric mean of the pixels.
    spread
        (N,) standard deviation of the log of the radiance between views: highlights move, matte surface does not.
    group
        (N,) int64 number of the part and facing: surface that may be of one colour.
    triangle
        (N,) int64 triangle of the first sample.
    """

    position: np.ndarray
    normal: np.ndarray
    radiance: np.ndarray
    spread: np.ndarray
    group: np.ndarray
    triangle: np.ndarray

    def chosen(self, rows: np.ndarray) -> "Blocks":
        """Those of ``rows``, (N,) bool or indices."""
        return Blocks(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def beyond(self, mesh: Mesh, hidden: np.ndarray, box: Mapping[str, np.ndarray]) -> np.ndarray:
        """(T, 2, 3) float32 radiance of both sides of ``hidden`` triangles (T,) in planes of which blocks show a part.

        NaN elsewhere. A ceiling goes on beyond the frames of all views: it is as bright there as the blocks of it that
        are nearest. Planes lie along the axes, in one connected part, and are as thick as those of blocks at most. The
        first side is the one to which the normal points. ``box`` has the ``side`` of the scene box (cache.npz).
        """
        result = np.full((len(mesh.triangles), 2, 3), np.nan, np.float32)
        asked, part = np.flatnonzero(hidden & (mesh.areas > 0)), connected_parts(mesh)
        depth = float(box["side"]) / _PLANES
        way, center = facings(mesh.normals[asked]), mesh.corners[asked].mean(axis=1)
        own = np.column_stack([part[self.triangle], facings(self.normal[:, 0])])
        surfaces, count = np.unique(own, axis=0, return_counts=True)
        least = max(_LARGE * len(own), 1)
        for owner, facing in surfaces[count >= least]:
            rows, axis = np.flatnonzero((own == (owner, facing)).all(axis=1)), facing // 2
            stretch = np.where(np.arange(3) == axis, _PLANES, 1.0)  # what lies off the plane is far away
            place, level = self.position[rows, 0] * stretch, self.position[rows, 0, axis].astype(np.float64)
            for side in (0, 1):  # facings of opposite ways are 2 k and 2 k + 1
                there = np.flatnonzero((part[asked] == owner) & (way ^ side == facing))
                height = center[there, axis]
                first, last = (np.searchsorted(np.sort(level), height + d) for d in (-depth, depth))
                there, height = there[last - first >= least], height[last - first >= least]
                _, near = cKDTree(place).query(center[there] * stretch, k=range(1, min(_BESIDE, len(rows)) + 1))
                same = np.abs(height[:, None] - level[near]) <= depth
                result[asked[there], side] = _mean_of_log(self.radiance[rows][near], same)
        return result

    @property
    def white(self) -> float:
        """Mean radiance of white surface under the light of the room, if surface is as bright as in most rooms."""
        return float(np.median(self.radiance.mean(axis=1)) / np.exp(MIDDLE))

    @property
    def brightest(self) -> float:
        """Mean radiance of the brightest of them that shows no lamp: pixels beside lamps hold some of their light."""
        return float(np.quantile(self.radiance.mean(axis=1), _REFLECTING, method="lower"))


def blocks_of(
    shards: Sequence[ObservedShard],
    mesh: Mesh,
    emitting: np.ndarray,
    box: Mapping[str, np.ndarray],
    most: int = MANY_BLOCKS,
    points: int = 4,
) -> Blocks:
    """Gather the pixels of all training views into blocks.

    Parameters
    ----------
    emitting
        (T,) bool: triangles that are known to emit; their pixels tell nothing of a reflectance.
    box
        ``center`` and ``side`` of the scene box (cache.npz).
    most
        Blocks that are wanted, and no more: they are as large as that lets them be.
    points
        Samples R of each block.
    """
    part = connected_parts(mesh)
    columns: list[list[np.ndarray]] = []
    number = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            triangle = np.asarray(samples.triangle[own])
            use = (samples.weight[own] >= ALONE) & (shard.weight[pixel] > 0) & ~shard.clipped[pixel]
            use = np.flatnonzero(use & ~emitting[triangle])
            position, normal = np.asarray(samples.position[own])[use], np.asarray(samples.normal[own])[use]
            color = np.log(np.maximum(np.asarray(shard.radiance[pixel[use]], np.float64), 1e-5))
            columns.append([position, normal, color, triangle[use], np.full(len(use), number)])
            number += 1
    position, normal, color, of_sample, view = (np.concatenate(c) for c in zip(*columns, strict=True))
    owner = part[of_sample]
    facing = facings(normal).astype(np.int64)
    # a scan is one part: planes tell its walls from what stands before them
    along = np.take_along_axis(position, facing[:, None] // 2, 1)[:, 0] / float(box["side"])
    scanned = np.bincount(owner)[owner] > _SCANNED * len(owner)
    group = np.column_stack([owner, facing, np.where(scanned, np.round(along * _PLANES), 0).astype(np.int64)])
    group = np.unique(group @ (1 << 40, 1 << 20, 1), return_inverse=True)[1]
    block, kept = np.zeros(len(group), np.int64), np.zeros(0, np.int64)
    for rows in _GRIDS:
        voxel = voxel_keys(position, box["center"], float(box["side"]), rows) * (group.max(initial=0) + 1) + group
        _, own, count = np.unique(voxel, return_inverse=True, return_counts=True)
        full = np.flatnonzero(count >= _LEAST_PIXELS)
        if len(full) < len(kept):  # pixels are larger than the cells
            break
        block, kept = own, full
        if len(kept) >= most:
            break
    if len(kept) > most:
        kept = np.sort(np.random.default_rng(0).permutation(kept)[:most])
    return _gathered(kept, block, (position, normal, color, group, view, of_sample), points)


def _mean_of_log(radiance: np.ndarray, use: np.ndarray) -> np.ndarray:
    """(N, 3) geometric means of radiances (N, K, 3) where ``use`` (N, K); NaN of none."""
    count = use.sum(axis=1)[:, None]
    total = (np.log(np.maximum(radiance, 1e-12)) * use[..., None]).sum(axis=1)
    return np.where(count > 0, np.exp(total / np.maximum(count, 1)), np.nan)


def _gathered(kept: np.ndarray, block: np.ndarray, columns: tuple[np.ndarray, ...], points: int) -> Blocks:
    """Means of the blocks that are ``kept``; ``block`` (S,) is that of each sample."""
    place = np.full(int(block.max(initial=-1)) + 1, -1)
    place[kept] = np.arange(len(kept))
    row = place[block]
    position, normal, color, group, view, triangle, row = (a[row >= 0] for a in (*columns, row))
    rows = len(kept)
    count = np.bincount(row, minlength=rows)
    mean = np.stack([np.bincount(row, color[:, c], rows) / np.maximum(count, 1) for c in range(3)], axis=1)
    # between views: variance of the means of views
    pair, inverse = np.unique(row * (int(view.max(initial=0)) + 1) + view, return_inverse=True)
    level = np.bincount(inverse, color.mean(axis=1)) / np.bincount(inverse)
    owner = pair // (int(view.max(initial=0)) + 1)
    views = np.maximum(np.bincount(owner, minlength=rows), 1)
    middle = np.bincount(owner, level, rows) / views
    spread = np.sqrt(np.bincount(owner, (level - middle[owner]) ** 2, rows) / np.maximum(views - 1, 1))
    order = np.argsort(row, kind="stable")
    start = np.cumsum(count) - count
    pick = (np.random.default_rng(0).random((rows, points)) * count[:, None]).astype(np.int64)
    chosen = order[start[:, None] + pick]
    first = order[start]
    return Blocks(position[chosen], normal[chosen], np.exp(mean), spread, group[first], triangle[chosen[:, 0]])


def spacing(place: np.ndarray) -> float:
    """Metres from a block to its fourth neighbour, in the median of the places (N, 3)."""
    return float(np.median(cKDTree(place).query(place, k=[min(5, len(place))])[0]))


def errors_alike(residual: np.ndarray, place: np.ndarray) -> float:
    """How many blocks err as one: 1 + the sum of the correlations with a block's neighbours.

    Neighbours of another colour count too: where the mesh is wrong, the light is wrong on all of them.
    """
    z = np.clip(residual, -2, 2)
    z = z - z.mean()
    a, b = cKDTree(place).query_pairs(3 * spacing(place), output_type="ndarray").T
    return max(1.0, float(1 + 2 * (z[a] * z[b]).sum() / max((z * z).sum(), 1e-12)))
