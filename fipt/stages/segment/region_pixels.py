"""What the training views show of each region of the surface: pixels that one region fills, with their shading.

And pixels of which it fills most, less what the others there reflect: a chair's leg fills hardly a pixel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from fipt.conventions import EMITTER_GAIN, SHADING_OUTPUTS
from fipt.model.reflectance import exceeds_reflection
from fipt.scene.environment import covered_share
from fipt.scene.observed import ObservedShard, filled_by_one, full_pixels
from fipt.scene.samples import FootprintSamples, scattered, segments_of_triangles

_MOST = 400_000
"""Pixels used at most: the material of a region does not need more."""
_WHOLE = 0.99
"""Share of a pixel that surface covers, from which it is taken for whole."""


_MOSTLY = 0.5
"""Share of a pixel that a region fills, above which it tells something of the region: most of it."""
_REGIONS = 65536
"""More than there are regions: ids have 16 bits."""

_RegionOf = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Regions (K,) of samples, by their pixels (K,) and numbers (K,)."""


@dataclass(frozen=True)
class RegionPixels:
    """N pixels, each of one region: it fills them, or most of them, and what others reflect is taken off.

    Attributes
    ----------
    radiance
        (N, 3) float32 observed; of the region alone.
    shading
        (N, outputs, 3) float32 Ld, Ls0 and Ls1 of every level, mean over what the region fills of the pixel.
    place, normal
        (N, 3) float32, metres; unit length.
    region
        (N,) int64 from 1.
    triangle
        (N,) int32 that the centre shows, or the region's first sample.
    share
        (N,) float32 of the pixel that the region fills.
    """

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    region: np.ndarray
    triangle: np.ndarray
    share: np.ndarray

    def of(self, chosen: np.ndarray) -> "RegionPixels":
        """The ``chosen`` ones (N,) bool."""
        return RegionPixels(*(array[chosen] for array in vars(self).values()))

    def with_others(self, others: "RegionPixels") -> "RegionPixels":
        """These, then others."""
        return RegionPixels(*map(np.concatenate, zip(vars(self).values(), vars(others).values(), strict=True)))


RadianceOf = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Radiance (K, 3) of samples by their regions (K,), places and normals (K, 3) and shading (K, outputs, 3); NaN where
nobody knows."""


def region_pixels(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]) -> RegionPixels:
    """Gather the pixels of all training views that one region fills.

    Clipped pixels are left out, and those that show an emitter. Those that regions share are another matter
    (`shared_pixels`): what the others reflect would be taken for a region's own.

    Parameters
    ----------
    regions
        Per shard: (P,) region of each pixel, 0 = unknown.
    """
    return _gathered(shards, regions, _filled)


def shared_pixels(
    shards: Sequence[ObservedShard], regions: Sequence[np.ndarray], radiance_of: RadianceOf
) -> RegionPixels:
    """Gather the pixels that a region shares with others, and of which it fills most.

    Parameters
    ----------
    regions
        As of `region_pixels`.
    radiance_of
        What the others reflect. A pixel is left out that shows one of which it is not known, or that is darker in any
        channel than what they reflect.
    """
    return _gathered(shards, regions, partial(_mostly_filled, radiance_of))


def _gathered(
    shards: Sequence[ObservedShard],
    regions: Sequence[np.ndarray],
    pixels_of: Callable[[ObservedShard, np.ndarray, _RegionOf], tuple[np.ndarray, ...]],
) -> RegionPixels:
    """The pixels that ``pixels_of`` makes of a shard and some of its pixels (N,)."""
    step = max(sum(len(each) for each in regions) // _MOST, 1)
    _, of_triangle = segments_of_triangles([shard.samples for shard in shards], regions)
    found, passed = [], 0
    for shard, own in zip(shards, regions, strict=True):
        usable = _usable(shard)
        pixel = usable[scattered(passed, len(usable), step)]
        passed += len(usable)
        arrays = pixels_of(shard, pixel, partial(_region_of, shard.samples, own, of_triangle))
        radiance, shading, _, _, region, _, _ = arrays
        keep = ~exceeds_reflection(radiance, shading, EMITTER_GAIN) & (region > 0)
        found.append([np.asarray(array)[keep] for array in arrays])
    return RegionPixels(*map(np.concatenate, zip(*found, strict=True)))


def _usable(shard: ObservedShard) -> np.ndarray:
    """Pixels (N,) of a shard that surface fills, neither invalid nor clipped."""
    covered = np.concatenate([covered_share(shard.samples, index) for index in range(len(shard.samples.views))])
    return np.flatnonzero((covered > _WHOLE) & full_pixels(shard.samples, shard.weight) & ~shard.clipped)


def _region_of(
    samples: FootprintSamples, region: np.ndarray, of_triangle: np.ndarray, pixel: np.ndarray, sample: np.ndarray
) -> np.ndarray:
    """(K,) int64 region of samples (K,) of pixels (K,).

    An id map (P,) knows pixel centres only; beside them, a triangle is of the region that most centres give it.
    """
    center = (np.asarray(samples.offsets[pixel]) == sample) & (np.asarray(samples.center[pixel]) > 0)
    return np.where(center, region[pixel], of_triangle[np.asarray(samples.triangle[sample])]).astype(np.int64)


def _filled(shard: ObservedShard, chosen: np.ndarray, region_of: _RegionOf) -> tuple[np.ndarray, ...]:
    """The arrays of `RegionPixels` of those of ``chosen`` pixels (N,) that one region fills."""
    samples = shard.samples
    pixel, first, region, shading = filled_by_one(samples, shard.shading, chosen, region_of)
    surface = (samples.position[first], samples.normal[first], region, samples.triangle[first])
    return (np.asarray(shard.radiance[pixel], np.float32), shading, *surface, np.ones(len(pixel), np.float32))


def _mostly_filled(
    radiance_of: RadianceOf, shard: ObservedShard, chosen: np.ndarray, region_of: _RegionOf
) -> tuple[np.ndarray, ...]:
    """The arrays of those of which one region fills most, but not all."""
    samples = shard.samples
    chosen, row, sample, region, weight, largest = _of_mostly_filled(samples, chosen, region_of)
    if len(chosen) == 0:
        return _filled(shard, chosen, region_of)
    shading = np.asarray(shard.shading[sample], np.float32).reshape(-1, SHADING_OUTPUTS, 3)
    place, normal = np.asarray(samples.position[sample]), np.asarray(samples.normal[sample])
    rest = weight[~largest, None] * radiance_of(region[~largest], place[~largest], normal[~largest], shading[~largest])
    others = np.stack([np.bincount(row[~largest], channel, len(chosen)) for channel in rest.T], axis=1)
    share = np.bincount(row[largest], weight[largest])
    radiance = (shard.radiance[chosen] - others) / share[:, None]
    at = np.flatnonzero(largest)
    starts = np.flatnonzero(np.diff(row[at], prepend=-1))
    first = at[starts]
    mean = np.add.reduceat(shading[at] * (weight[at] / share[row[at]])[:, None, None], starts, axis=0)
    surface = (place[first], normal[first], region[first], np.asarray(samples.triangle[sample[first]]))
    known = (radiance > 0).all(axis=1)  # not so where it is NaN
    arrays = (radiance.astype(np.float32), mean.astype(np.float32), *surface, share.astype(np.float32))
    return tuple(array[known] for array in arrays)


def _of_mostly_filled(
    samples: FootprintSamples, chosen: np.ndarray, region_of: _RegionOf
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Those of ``chosen`` pixels (N,) of which one region fills most, but not all, and their samples (K,), by pixel.

    Of each sample its pixel's row among them, its number, its region, its share of the pixel, and whether it is of the
    region that fills most.
    """
    row, sample = samples.samples_of(chosen)
    region = region_of(chosen[row], sample)
    weight = np.asarray(samples.weight[sample], np.float64)
    weight /= np.bincount(row, weight, len(chosen))[row]
    key, group = np.unique(row * _REGIONS + region, return_inverse=True)
    fills = np.bincount(group.reshape(-1), weight, len(key))[group.reshape(-1)]
    most = np.zeros(len(chosen))
    np.maximum.at(most, row, fills)
    several = np.bincount(key // _REGIONS, minlength=len(chosen)) > 1
    kept = several & (most > _MOSTLY)
    at = kept[row]
    row, sample, region, weight, fills = row[at], sample[at], region[at], weight[at], fills[at]
    return chosen[kept], (np.cumsum(kept) - 1)[row], sample, region, weight, fills > _MOSTLY
