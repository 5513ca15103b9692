"""Radiance cache: the light that leaves the surface, averaged over all views (surface light field).

A record belongs to a voxel and to the axis that the surface faces there, so that the two sides of a shelf, or a pane
and the sill below it, do not lend each other their light.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fipt.formats.files import check_disk, check_memory
from fipt.scene.mesh import Mesh, connected_parts, point_counts, surface_points
from fipt.scene.mixed import Unmixed, find_islands, unmixed
from fipt.scene.samples import FootprintSamples, scene_box
from fipt.scene.voxels import FACINGS, along_surface, facings, voxel_keys
from fipt.stages.cache.settings import CacheSettings
from fipt.stages.cache.sums import BYTES_A_PAIR, Samples, Sums, beside_nearer, most_pairs

_INTERIOR = 0.95
"""Pixels of which one piece covers at least this share tell a voxel's radiance; others mix surfaces."""
_BYTES_A_POINT, _BYTES_A_SAMPLE = 100, 200
"""Of memory: for a point that is tried on the surface (measured 70 with 4 million, 90 with 16), for a sample of the
largest view."""
_BYTES_ON_DISK = 11
"""Of the file, for such a point: measured 9.9 and 10.2."""
_CELL = 8
"""Voxels along a cell in which views are compared: some 12 cm, in which several views have pixels."""
_MIXED = 1e-3
"""Weight of those others: they count only where nothing better is known."""


def build(
    mesh: Mesh,
    shards: list[FootprintSamples],
    images: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]],
    settings: CacheSettings,
) -> dict[str, np.ndarray]:
    """Average the radiance of all pixels in voxels over the surface; one view at a time is in memory.

    Parameters
    ----------
    images
        Of every view of every shard, in order: (P, 3) float32 radiance, (P,) weight of its pixels, and (P,) bool
        whether their radiance is only a lower bound.

    Returns
    -------
    dict
        ``center`` (3,) float64 and ``side`` of the box (metres), ``resolution``; K records sorted by ``key`` (K,) int64
        of their voxel, then ``facing`` (K,) uint8; ``point`` (K, 3) float32 a point of that surface in the voxel,
        ``radiance`` (K, 3) float32, ``count`` (K,) float32 pixels that it fills (0: its radiance is mixed or not
        known), ``part`` (K,) int32 connected part of the mesh, ``source`` (K,) int32 the record that stands for it
        where no view sees it: the nearest seen one, of the same connected part and not mixed if it can be.
    """
    center, side = scene_box(shards)
    n = settings.resolution
    views = [(samples, index) for samples in shards for index in range(len(samples.views))]

    def keys(samples: FootprintSamples, own: slice) -> np.ndarray:
        return voxel_keys(samples.position[own], center, side, n) * FACINGS + facings(samples.normal[own])

    records, islands = _Records(), find_islands(mesh, shards)
    for samples, index in views:
        own = samples.of_view(index)
        records.add(keys(samples, own), samples.position[own], samples.triangle[own])
    surface, owner = surface_points(mesh, side / n / 3, center - side / 2, center + side / 2, seed=0)
    voxel = voxel_keys(surface, center, side, n) * FACINGS
    for turn in (1, -1):  # surfaces have two sides
        records.add(voxel + facings(turn * mesh.normals[owner]), surface, owner)

    sums = Sums(_around(records, center, side, n), _MIXED)
    for (samples, index), (image, valid, clipped) in zip(views, images, strict=True):
        own, pixel = samples.of_view(index), samples.pixel_of_sample(index)
        record = np.searchsorted(records.key, keys(samples, own))
        weight = valid[pixel] * np.where(samples.weight[own] >= _INTERIOR, 1.0, _MIXED)
        found = unmixed(samples, index, islands, image, (valid > 0) & ~clipped)
        light = _unmixed_light(found, image[pixel], weight)
        sums.add(Samples(record, *light, clipped[pixel], beside_nearer(samples, index)))
    sums.finish()
    cache = {
        "center": center,
        "side": np.array(side, np.float64),
        "resolution": np.array(n, np.int64),
        "key": records.key // FACINGS,
        "facing": (records.key % FACINGS).astype(np.uint8),
        "point": records.point,
        "radiance": (sums.total / np.maximum(sums.weight, 1e-12)[:, None]).astype(np.float32),
        "count": sums.count.astype(np.float32),
        "part": connected_parts(mesh)[records.triangle].astype(np.int32),
    }
    return cache | {"source": _nearest_seen(cache, sums.seen, sums.count > 0)}


def check_room(mesh: Mesh, shards: list[FootprintSamples], settings: CacheSettings, out: Path) -> None:
    """Refuse a cache that memory or the disk of ``out`` are too small for: it grows with the resolution squared.

    Raises
    ------
    FiptError
        One line that says how much it needs.
    """
    center, side = scene_box(shards)
    points = int(point_counts(mesh, side / settings.resolution / 3, center - side / 2, center + side / 2).sum())
    own = [samples.of_view(index) for samples in shards for index in range(len(samples.views))]
    largest = max((each.stop - each.start for each in own), default=0)
    needed = _BYTES_A_POINT * points + _BYTES_A_SAMPLE * largest
    needed += BYTES_A_PAIR * most_pairs(shards, side / settings.resolution)
    check_memory(needed, "the radiance cache", "use a smaller cache.resolution")
    check_disk(out.parent, _BYTES_ON_DISK * points, "the radiance cache")


def _around(records: "_Records", center: np.ndarray, side: float, resolution: int) -> np.ndarray:
    """(K,) int64 number of the cell of `_CELL` voxels, and of the facing, of each record."""
    cells = voxel_keys(records.point, center, side, -(-resolution // _CELL))
    return cells * FACINGS + records.key % FACINGS


def _unmixed_light(found: Unmixed, light: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (N, 3) and weight (N,) of a view's samples: mixed ones have their own radiance where that is told."""
    mixed = weight[found.sample] <= _MIXED
    rows, light, weight = found.sample[mixed], light.astype(np.float64), weight.astype(np.float64)
    doubt = found.error[mixed] / np.maximum(light[rows].mean(axis=1), 1e-6)
    light[rows] = found.radiance[mixed]
    weight[rows] /= 1 + doubt**2
    return light, weight


class _Records:
    """Sorted keys of voxel and facing, with the first point added to each and its triangle."""

    def __init__(self) -> None:
        self.key = np.zeros(0, np.int64)
        self.point = np.zeros((0, 3), np.float32)
        self.triangle = np.zeros(0, np.int64)

    def add(self, key: np.ndarray, point: np.ndarray, triangle: np.ndarray) -> None:
        """Add points (N, 3) with their keys and triangles (N,)."""
        key, first = np.unique(key, return_index=True)
        place = np.searchsorted(self.key, key)
        known = np.zeros(len(key), bool)
        inside = place < len(self.key)
        known[inside] = self.key[place[inside]] == key[inside]
        place, first = place[~known], first[~known]
        self.key = np.insert(self.key, place, key[~known])
        self.point = np.insert(self.point, place, point[first], axis=0)
        self.triangle = np.insert(self.triangle, place, triangle[first])


def _nearest_seen(cache: dict[str, np.ndarray], seen: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """(K,) int32 index of the record that stands for one that is not ``seen``; itself where it is.

    The nearest one, of the same connected part before others; of these one that pixels have ``filled`` before one that
    they show in a mixture with something else, perhaps with a lamp.
    """
    facing, part = cache["facing"], cache["part"]
    source = np.arange(len(facing), dtype=np.int32)
    if not seen.any():
        return source
    for axis in range(3):
        place = along_surface(cache, axis)
        asked = np.flatnonzero(~seen & (facing // 2 == axis))
        for pool, own in ((filled, True), (seen, True), (filled, False), (seen, False)):
            chosen = np.flatnonzero(pool)
            if len(asked) == 0 or len(chosen) == 0:
                continue
            columns = slice(None) if own else slice(6)
            _, nearest = cKDTree(place[chosen, columns]).query(place[asked, columns], workers=-1)
            right = (part[chosen[nearest]] == part[asked]) | (not own)
            source[asked[right]] = chosen[nearest[right]]
            asked = asked[~right]
    return source
