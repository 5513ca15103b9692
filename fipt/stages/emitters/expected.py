"""Whether surface that should emit is as bright as it should be, in the pixels that it shares with other surface.

A pixel of which a lamp of radiance L has the share w has at least w L. So the light that known emitters leave, summed
over pixels with weights w, is at least that of the sum of w^2 L: errors of the shares cancel in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.scene.emitters import Emitters
from fipt.scene.observed import ObservedShard

_LEAST_SHARE = 0.2
"""Of a pixel: a smaller share hardly changes its light."""
_SHINES = 0.5
"""Of the expected light, above which surface is nearer to shining than to dark."""


@dataclass(frozen=True)
class Expected:
    """What pixels say of K groups of surface that should emit.

    Attributes
    ----------
    shown
        (K,) bool: a pixel shows enough of it to tell.
    shines
        (K,) bool: what is shown has most of the light that is expected.
    views
        (K,) int64 views that show it.
    """

    shown: np.ndarray
    shines: np.ndarray
    views: np.ndarray


def as_expected(shards: Sequence[ObservedShard], found: Emitters, group: np.ndarray, level: np.ndarray) -> Expected:
    """Compare the pixels of groups of triangles with the radiance that is expected of them.

    Parameters
    ----------
    shards
        The training views.
    found
        Emitters that are known; none of them is in a group.
    group
        (T,) int64 number of the group of each triangle, -1 for none.
    level
        (K,) mean radiance that is expected of each group.
    """
    light, count = np.zeros(len(group)), len(level)
    light[found.triangle] = found.radiance.mean(axis=1)
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
            there += np.bincount(of[tells], (part * left)[tells], count)
            expected += np.bincount(of[tells], (part**2 * level[of])[tells], count)
            views += np.bincount(of[tells], minlength=count) > 0
    shown = expected > 0
    return Expected(shown, shown & (there >= _SHINES * expected), views)
