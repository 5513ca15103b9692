"""What the training views show of each region of the surface: pixels that one region fills, with their shading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.conventions import EMITTER_GAIN, SHADING_OUTPUTS
from fipt.model.reflectance import exceeds_reflection
from fipt.scene.observed import ObservedShard

_MOST = 400_000
"""Pixels used at most: the material of a region does not need more."""
_SOLE = 0.99
"""Share of its pixel from which a piece of surface is taken to fill it: no ray of the pixel misses it then."""


@dataclass(frozen=True)
class RegionPixels:
    """N pixels that one region fills, or at least half of where none fills one.

    Attributes
    ----------
    radiance
        (N, 3) float32 observed.
    shading
        (N, outputs, 3) float32 Ld, Ls0 and Ls1 of every level.
    place, normal
        (N, 3) float32, metres; unit length.
    region
        (N,) int64 from 1.
    """

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    region: np.ndarray


def region_pixels(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]) -> RegionPixels:
    """Gather the pixels of all training views.

    Clipped pixels are left out, and those that show an emitter. Of regions that never fill a pixel, those that they
    fill most of are taken.

    Parameters
    ----------
    regions
        Per shard: (P,) region of each pixel, 0 = unknown.
    """
    step = max(sum(len(each) for each in regions) // _MOST, 1)
    found = [_of_shard(shard, own, step) for shard, own in zip(shards, regions, strict=True)]
    radiance, shading, place, normal, region, sole = map(np.concatenate, zip(*found, strict=True))
    filled = np.zeros(int(region.max(initial=0)) + 1, bool)
    filled[region[sole]] = True
    use = sole | ~filled[region]
    return RegionPixels(radiance[use], shading[use], place[use], normal[use], region[use])


def _of_shard(shard: ObservedShard, region: np.ndarray, step: int) -> tuple[np.ndarray, ...]:
    """Every ``step``-th pixel of a shard: the arrays of `RegionPixels`, and (N,) bool whether the pixel is filled."""
    samples = shard.samples
    first = np.asarray(samples.offsets[:-1])
    usable = (np.asarray(samples.center) > 0) & (shard.weight > _SOLE) & ~shard.clipped & (region > 0)
    pixel = np.flatnonzero(usable)[::step]
    share = np.asarray(samples.weight)[first[pixel]]
    pixel, share = pixel[share >= 0.5], share[share >= 0.5]
    own = first[pixel]
    radiance = np.asarray(shard.radiance[pixel], np.float32)
    shading = np.asarray(shard.shading[own], np.float32).reshape(-1, SHADING_OUTPUTS, 3)
    keep = ~exceeds_reflection(radiance, shading, EMITTER_GAIN)
    arrays = (radiance, shading, samples.position[own], samples.normal[own], region[pixel].astype(np.int64))
    return tuple(np.asarray(array)[keep] for array in (*arrays, share > _SOLE))
