"""What the training views show of each region of the surface: pixels that one region fills, with their shading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.conventions import EMITTER_GAIN
from fipt.model.reflectance import exceeds_reflection
from fipt.scene.environment import covered_share
from fipt.scene.observed import ObservedShard, filled_by_one
from fipt.scene.samples import segments_of_triangles, strided

_MOST = 400_000
"""Pixels used at most: the material of a region does not need more."""
_WHOLE = 0.99
"""Weight of a pixel, and share of it that surface covers, from which it is taken for whole."""


@dataclass(frozen=True)
class RegionPixels:
    """N pixels that one region fills.

    Attributes
    ----------
    radiance
        (N, 3) float32 observed.
    shading
        (N, outputs, 3) float32 Ld, Ls0 and Ls1 of every level, mean over the pixel.
    place, normal
        (N, 3) float32, metres; unit length.
    region
        (N,) int64 from 1.
    triangle
        (N,) int64 that the centre shows.
    """

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    region: np.ndarray
    triangle: np.ndarray

    def of(self, chosen: np.ndarray) -> "RegionPixels":
        """The ``chosen`` ones (N,) bool."""
        return RegionPixels(*(array[chosen] for array in vars(self).values()))


def region_pixels(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]) -> RegionPixels:
    """Gather the pixels of all training views.

    Clipped pixels are left out, and those that show an emitter. A region has no other pixels than those that it fills:
    where it shares one, what the others beside it reflect would be taken for its own.

    Parameters
    ----------
    regions
        Per shard: (P,) region of each pixel, 0 = unknown.
    """
    step = max(sum(len(each) for each in regions) // _MOST, 1)
    _, of_triangle = segments_of_triangles([shard.samples for shard in shards], regions)
    usable = [_usable(shard) for shard in shards]
    rows = strided(map(len, usable), step)
    chosen = [pixel[own] for pixel, own in zip(usable, rows, strict=True)]
    found = [
        _of_shard(shard, own, of_triangle, pixel) for shard, own, pixel in zip(shards, regions, chosen, strict=True)
    ]
    return RegionPixels(*map(np.concatenate, zip(*found, strict=True)))


def _usable(shard: ObservedShard) -> np.ndarray:
    """Pixels (N,) of a shard that surface fills, neither invalid nor clipped."""
    covered = np.concatenate([covered_share(shard.samples, index) for index in range(len(shard.samples.views))])
    return np.flatnonzero((covered > _WHOLE) & (shard.weight > _WHOLE) & ~shard.clipped)


def _of_shard(
    shard: ObservedShard, region: np.ndarray, of_triangle: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The arrays of `RegionPixels` of ``chosen`` pixels (N,) of a shard."""
    samples, offsets = shard.samples, np.asarray(shard.samples.offsets)

    def region_of(pixel: np.ndarray, sample: np.ndarray) -> np.ndarray:
        """An id map knows pixel centres only; beside them, a triangle is of the region that most centres give it."""
        center = (offsets[pixel] == sample) & (np.asarray(samples.center[pixel]) > 0)
        return np.where(center, region[pixel], of_triangle[np.asarray(samples.triangle[sample])]).astype(np.int64)

    pixel, first, own, shading = filled_by_one(samples, shard.shading, chosen, region_of)
    radiance = np.asarray(shard.radiance[pixel], np.float32)
    keep = ~exceeds_reflection(radiance, shading, EMITTER_GAIN) & (own > 0)
    arrays = (radiance, shading, samples.position[first], samples.normal[first], own, samples.triangle[first])
    return tuple(np.asarray(array)[keep] for array in arrays)
