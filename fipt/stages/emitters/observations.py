"""What pixels say of the triangles that they show: one view at a time, and medians of many."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from fipt.groups import grouped_median, grouped_quantile
from fipt.model.reflectance import brightest_reflection
from fipt.robust import NORMAL
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE

_BRIGHTEST = 0.9
"""Quantile of the bounds of a clipped emitter that stands for its radiance; the last tenth may be sharpened edges."""


@dataclass(frozen=True)
class Observations:
    """N pixels that one piece of surface fills.

    Attributes
    ----------
    triangle, view
        (N,) int64: the triangle, and the number of the view.
    radiance
        (N, 3) observed.
    ratio
        (N,) radiance over the most that could be reflected.
    clipped
        (N,) bool: the radiance is only a lower bound.
    sample
        (N,) int64 row of the sample in its shard.
    """

    triangle: np.ndarray
    radiance: np.ndarray
    view: np.ndarray
    ratio: np.ndarray
    clipped: np.ndarray
    sample: np.ndarray

    def __getitem__(self, rows: slice | np.ndarray) -> "Observations":
        return Observations(*(getattr(self, own.name)[rows] for own in fields(self)))

    @staticmethod
    def joined(parts: Iterable["Observations"]) -> "Observations":
        """All of these, in their order."""
        columns = zip(*([getattr(part, own.name) for own in fields(part)] for part in parts), strict=True)
        return Observations(*(np.concatenate(values) for values in columns))


def observations(shards: Sequence[ObservedShard], ratios: bool = True) -> Iterator[Observations]:
    """Yield the pixels of every view that one piece of surface fills; their ratio is 0 where it is not asked for."""
    number = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            use = np.flatnonzero((samples.weight[own] >= ALONE) & (shard.weight[pixel] > 0))
            radiance, rows = np.asarray(shard.radiance[pixel[use]]), use + own.start
            ratio = np.zeros(len(use), np.float32)
            if ratios:
                ratio = radiance.mean(axis=1) / brightest_reflection(np.asarray(shard.shading[rows], np.float32))
            yield Observations(
                np.asarray(samples.triangle[own])[use],
                radiance,
                np.full(len(use), number),
                ratio,
                shard.clipped[pixel[use]],
                rows,
            )
            number += 1


def of_triangles(views: Iterable[Observations], chosen: np.ndarray) -> Observations:
    """Observations of the triangles where ``chosen`` (T,) is true, all views together."""
    return Observations.joined(view[chosen[view.triangle]] for view in views)


def levels(radiance: np.ndarray, bound: np.ndarray, index: np.ndarray, groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Median radiance (groups, 3) of each group, and whether (groups,) that is only a lower bound.

    A clipped pixel below the median of what was measured agrees with it and counts as much. Where at least half of the
    pixels are bounds above it, nobody knows the radiance: the brightest bounds come nearest.
    """
    measured, inverse = np.unique(index[~bound], return_inverse=True)
    least = np.zeros((groups, 3))
    least[measured] = grouped_median(radiance[~bound], inverse, len(measured))
    above = bound & (radiance.mean(axis=1) > least[index].mean(axis=1))
    unknown = 2 * np.bincount(index, above, groups) >= np.maximum(np.bincount(index, minlength=groups), 1)
    raised = np.where(bound[:, None], np.maximum(radiance, least[index]), radiance)
    level = grouped_median(raised, index, groups).reshape(-1, 3)
    bounds = above & unknown[index]
    clipped, inverse = np.unique(index[bounds], return_inverse=True)
    level[clipped] = grouped_quantile(radiance[bounds], inverse, len(clipped), _BRIGHTEST)
    return level, unknown


def standard_errors(radiance: np.ndarray, view: np.ndarray, index: np.ndarray, groups: int) -> np.ndarray:
    """(groups, 3) standard error of each group's median, from how the medians of its views differ.

    Pixels of a view share what is wrong with it, so that a view is one observation. Where there is but one view, its
    pixels are all that is known.
    """
    views = int(view.max(initial=0)) + 1
    pair, place = np.unique(index * views + view, return_inverse=True)
    place = place.reshape(-1)
    own = pair // views
    each = grouped_median(radiance, place, len(pair))
    count = np.bincount(own, minlength=groups)
    alone = count < 2
    error = _error_of_median(each, own, groups)
    return np.where(alone[:, None], _error_of_median(radiance, index, groups), error)


def _error_of_median(values: np.ndarray, index: np.ndarray, groups: int) -> np.ndarray:
    """(groups, 3): 1.2533 standard deviations (1.4826 times the median deviation, normal noise) over root n."""
    count = np.maximum(np.bincount(index, minlength=groups), 1)[:, None]
    spread = grouped_median(np.abs(values - grouped_median(values, index, groups)[index]), index, groups)
    return 1.2533 * NORMAL * spread / np.sqrt(count)


def guess_confidence(spread: float) -> float:
    """Confidence of a guess by the relative spread of its power: halves where that is known by a factor of 2."""
    return float(0.5 * np.exp(-spread / 0.5))
