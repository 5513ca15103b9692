"""Sums of the cache: the radiance of records over all views, without what few of their pixels show.

Where the mesh lacks a part of a lamp, or has it a pixel beside its place, its pixels show the surface behind. There one
view tells of a lamp that others do not see, twenty to two hundred times as bright as the surface. Where no other view
shows the record, others show what is around it; then the lamp tells itself, too: the pixel is beside something nearer.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter

from fipt.scene.samples import FootprintSamples

log = logging.getLogger(__name__)

_BRIGHTER = 5.0
"""Times what the views show of a record in the median, and the room's surface, above which a view shows something else.

Highlights of polished surface stay below, lamps do not.
"""
_SLANT = 2.5
"""Records that a view shows, over those that its pixels cover across their rays: up to 2.3 on a floor."""
_NEARER = 0.1
"""Share of the distance by which something before a surface is nearer."""
BYTES_A_PAIR = 150
"""Of memory, for a view and a record that it shows: measured 126 with 4 million of them, 124 with 12."""


@dataclass(frozen=True)
class Samples:
    """N samples of a view.

    Attributes
    ----------
    record
        (N,) int64 record that each shows.
    radiance
        (N, 3).
    weight
        (N,).
    clipped
        (N,) bool: the radiance is only a lower bound.
    beside
        (N,) bool: the pixel, or one of the eight around it, shows something nearer (`beside_nearer`).
    """

    record: np.ndarray
    radiance: np.ndarray
    weight: np.ndarray
    clipped: np.ndarray
    beside: np.ndarray

    def chosen(self, rows: np.ndarray) -> "Samples":
        """Those of ``rows`` (N,) bool."""
        return Samples(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def beside_nearer(samples: FootprintSamples, index: int) -> np.ndarray:
    """(N,) bool: samples of a view beside which a pixel shows something nearer.

    A pixel is as wide as it is far, so that widths tell.
    """
    width = np.asarray(samples.footprint[samples.of_view(index)])
    height, columns = samples.shapes[index]
    pixel = samples.pixel_of_sample(index)
    nearest = np.full(height * columns, np.inf)
    np.minimum.at(nearest, pixel, width)
    nearest = minimum_filter(nearest.reshape(height, columns), 3, mode="nearest").ravel()
    return width - nearest[pixel] > _NEARER * width


@dataclass(frozen=True)
class _Shown:
    """What a view shows of M records.

    Attributes
    ----------
    record
        (M,) int64, ascending.
    shown
        (M,) float32 weight of all of its samples.
    level
        (M,) float32 radiance of all of its samples, mean of the channels; a clipped one counts as its bound.
    weight, total
        (M,) and (M, 3) float32 weight of its samples that are not clipped, and their radiance times weight.
    bound
        (M,) bool: whether most of that is clipped.
    filled
        (M,) bool: whether a sample fills a pixel.
    beside
        (M,) bool: whether most of what it shows is beside something nearer.
    bounds
        Of the clipped samples (B,) the place among the M, radiance (B, 3) and weight.
    """

    record: np.ndarray
    shown: np.ndarray
    level: np.ndarray
    weight: np.ndarray
    total: np.ndarray
    bound: np.ndarray
    filled: np.ndarray
    beside: np.ndarray
    bounds: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, samples: Samples, mixed: float) -> "_Shown":
        """Gather samples; those of more weight than ``mixed`` fill their pixels."""
        own, place = np.unique(samples.record, return_inverse=True)
        weight, radiance, clipped = samples.weight, samples.radiance, samples.clipped
        shown = np.bincount(place, weight, len(own))
        measured = weight * ~clipped
        total = np.stack([np.bincount(place, measured * column, len(own)) for column in radiance.T], axis=1)
        known = np.bincount(place, measured, len(own))
        return cls(
            record=own,
            shown=shown.astype(np.float32),
            level=(np.bincount(place, weight * radiance.mean(axis=1), len(own)) / shown).astype(np.float32),
            weight=known.astype(np.float32),
            total=total.astype(np.float32),
            bound=known < 0.5 * shown,
            filled=np.bincount(place, weight > mixed, len(own)) > 0,
            beside=np.bincount(place, weight * samples.beside, len(own)) > 0.5 * shown,
            bounds=(place[clipped], radiance[clipped].astype(np.float32), weight[clipped].astype(np.float32)),
        )


class Sums:
    """Sums over the samples of K records.

    Parameters
    ----------
    around
        (K,) int64 number of the cell of some centimetres that each record is in: others in it tell of the same surface.
    mixed
        Weight up to which a sample does not count as a pixel that its record fills.

    Attributes
    ----------
    total, weight
        (K, 3) radiance times weight, (K,) weight: after `finish`.
    count
        (K,) pixels that the records fill.
    seen
        (K,) bool, whether a valid pixel shows the record.
    cut
        Share of the radiance of all pixels that is something else's, and left out: after `finish`.
    """

    def __init__(self, around: np.ndarray, mixed: float) -> None:
        size, self._around = len(around), around
        self.total, self.weight, self.count = np.zeros((size, 3)), np.zeros(size), np.zeros(size)
        self.seen = np.zeros(size, bool)
        self.cut = 0.0
        self._mixed = mixed
        self._views: list[_Shown] = []

    def add(self, samples: Samples) -> None:
        """Add the samples of a view."""
        samples = samples.chosen(samples.weight > 0)
        self.seen[samples.record] = True
        np.add.at(self.count, samples.record, samples.weight * (samples.weight > self._mixed))
        self._views.append(_Shown.of(samples, self._mixed))

    def finish(self) -> None:
        """Sum over all views, each cut where it shows something else."""
        shares = _shares(self._views, self._around)
        # view by view, so that the sums do not depend on how the views are cut into shards
        for view, share in zip(self._views, shares, strict=True):
            self.weight[view.record] += view.weight
            self.total[view.record] += share[:, None] * view.total
        self._add_bounds(shares)
        light = [view.shown * view.level for view in self._views]
        left_out = sum(float(((1 - share) * each).sum()) for share, each in zip(shares, light, strict=True))
        self.cut = left_out / max(sum(float(each.sum()) for each in light), 1e-12)
        log.info("cache: %.1f %% of the light is left out: most views do not show it there", 100 * self.cut)
        self._views = []

    def _add_bounds(self, shares: list[np.ndarray]) -> None:
        """Add the clipped samples, which are lower bounds, such that they do not darken a record.

        A bound below what others measure there says nothing new and counts as they do; a surface of which there are
        only bounds is at least as bright as the highest of them.
        """
        bounds = [
            (view.record[place], share[place, None] * values, weight)
            for view, share in zip(self._views, shares, strict=True)
            for place, values, weight in [view.bounds]
        ]
        record, values, weight = map(np.concatenate, zip(*bounds, strict=True))
        highest = np.zeros_like(self.total)
        usable = weight > self._mixed
        np.maximum.at(highest, record[usable], values[usable])
        measured = self.weight > 0
        mean = self.total / np.maximum(self.weight, 1e-12)[:, None]
        least = np.where(measured[:, None], mean, highest)
        raised = np.maximum(values, least[record])
        for channel in range(3):
            np.add.at(self.total[:, channel], record, weight * raised[:, channel])
        np.add.at(self.weight, record, weight)


def most_pairs(shards: Sequence[FootprintSamples], side: float) -> int:
    """About how many records all views show, one by one; ``side`` of the voxels, metres."""
    return sum(int(np.minimum(1, _SLANT * (samples.footprint / side) ** 2).sum()) for samples in shards)


def _shares(views: list[_Shown], cell: np.ndarray) -> list[np.ndarray]:
    """(M,) share of its radiance that is kept of each record that a view shows, for each view.

    Of two views that show as much of a record the darker one is the median; but nothing is cut below what the room's
    surface has, since something dark may be missing as well. What is clipped may be as bright as anything. What is
    beside something nearer is compared with what views show around it, too: ``cell`` (K,) is that of each record.
    """
    names = ("record", "level", "shown", "bound", "beside")
    record, level, shown, bound, beside = (np.concatenate([getattr(view, name) for view in views]) for name in names)
    if len(record) == 0:
        return [np.ones(0) for _ in views]
    possible = np.where(bound, np.inf, level)
    number, median = _medians(record, possible, shown)
    lit = median[(median > 0) & np.isfinite(median)]
    room = np.median(lit) if len(lit) else 0.0
    usual = np.maximum(median, room)[np.searchsorted(number, record)]
    share = np.minimum(_BRIGHTER * usual / np.maximum(level, 1e-12), 1)
    around = np.maximum(_around(views, cell, possible), room)
    stranger = beside & (level > _BRIGHTER * around)
    share = np.where(stranger, np.minimum(share, around / np.maximum(level, 1e-12)), share)
    return np.split(share, np.cumsum([len(view.record) for view in views])[:-1])


def _around(views: list[_Shown], cell: np.ndarray, possible: np.ndarray) -> np.ndarray:
    """(P,) what views show around each of all records that they show: of the brightest of each view the median.

    ``cell`` (K,) is that of each record, ``possible`` (P,) the radiance, infinite where it is a bound. Where no view
    fills a pixel there, it is infinite.
    """
    of_pair = cell[np.concatenate([view.record for view in views])]
    filled = np.concatenate([view.filled for view in views])
    number = np.repeat(np.arange(len(views)), [len(view.record) for view in views])
    pair, place = np.unique(of_pair * len(views) + number, return_inverse=True)
    brightest = np.full(len(pair), -np.inf)
    np.maximum.at(brightest, place[filled], possible[filled])
    known = brightest >= 0
    cells, median = _medians(pair[known] // len(views), brightest[known], np.ones(int(known.sum())))
    at = np.searchsorted(cells, of_pair)
    found = np.append(cells, -1)[at] == of_pair
    return np.where(found, np.append(median, np.inf)[at], np.inf)


def _medians(group: np.ndarray, value: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(G,) the groups in ascending order, and the weighted median of each: of equals the smaller."""
    order = np.lexsort((value, group))
    start = np.flatnonzero(np.diff(group[order], prepend=-1))
    upto = np.cumsum(weight[order], dtype=np.float64)
    before = np.append(0, upto)[start]
    total = np.append(before[1:], upto[-1:]) - before
    # the first whose weight, and those of the smaller ones, is half of all
    at = np.searchsorted(upto, before + 0.5 * total * (1 - 1e-6))
    at = np.clip(at, start, np.append(start[1:], len(group)) - 1)  # of weights below the rounding of the sum
    return group[order][start], value[order][at]
