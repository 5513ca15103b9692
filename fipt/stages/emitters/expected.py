"""Whether surface that should emit is as bright as it should be, in the pixels that it shares with other surface.

A pixel of which a lamp of radiance L has the share w has w L more than its other surface sends there. So what that
leaves of the pixels, summed with weights w, is the sum of w^2 L: errors of the shares cancel in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.scene.emitters import Emitters
from fipt.scene.observed import ObservedShard

_LEAST_SHARE = 0.2
"""Of a pixel: a smaller share hardly changes its light."""
_EMITTING = 0.5
"""Of the expected light, above which surface is nearer to shining than to dark."""


@dataclass(frozen=True)
class Expected:
    """What pixels say of K groups of surface that should emit.

    Attributes
    ----------
    shown
        (K,) bool: a pixel shows enough of it to tell.
    emits
        (K,) bool: what is shown, clipped pixels apart, has most of the light that is expected.
    views
        (K,) int64 views that show it.
    """

    shown: np.ndarray
    emits: np.ndarray
    views: np.ndarray


def known_light(found: Emitters, radiance: np.ndarray) -> np.ndarray:
    """(T,) mean radiance of triangles: of known emitters, else that of pixels which they fill, (T, 3), else 0."""
    light = np.nan_to_num(radiance.mean(axis=1))
    light[found.triangle] = found.radiance.mean(axis=1)
    return light


def as_expected(shards: Sequence[ObservedShard], light: np.ndarray, group: np.ndarray, level: np.ndarray) -> Expected:
    """Compare the pixels of groups of triangles with the radiance that is expected of them.

    Parameters
    ----------
    shards
        The training views.
    light
        (T,) mean radiance of each triangle, as far as it is known (`known_light`); that of groups does not count.
    group
        (T,) int64 number of the group of each triangle, -1 for none.
    level
        (K,) mean radiance that is expected of each group.
    """
    light, count = np.where(group < 0, light, 0), len(level)
    there, expected = np.zeros((2, count))
    views = np.zeros(count, np.int64)
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel, first = samples.of_view(index), samples.pixel_of_sample(index), samples.pixels(index)
            triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own], np.float64)
            rows = np.flatnonzero((group[triangle] >= 0) & (np.asarray(shard.weight[first])[pixel] > 0))
            key, place = np.unique(pixel[rows] * count + group[triangle[rows]], return_inverse=True)
            of, part = key % count, np.bincount(place.reshape(-1), share[rows], len(key))
            pixels = np.asarray(shard.radiance[first]).mean(axis=1)
            left = np.maximum(pixels - np.bincount(pixel, share * light[triangle], len(pixels)), 0)[key // count]
            tells = part >= _LEAST_SHARE
            known = tells & ~np.asarray(shard.clipped[first])[key // count]  # which may be as bright as is expected
            there += np.bincount(of[known], (part * left)[known], count)
            expected += np.bincount(of[known], (part**2 * level[of])[known], count)
            views += np.bincount(of[tells], minlength=count) > 0
    return Expected(views > 0, (expected > 0) & (there >= _EMITTING * expected), views)
