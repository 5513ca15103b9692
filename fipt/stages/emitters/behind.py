"""Surface behind slats, leaves and bars that no pixel shows alone: which of it belongs to an emitter.

The pixels of such a triangle show shares w of it, and other surface beside it. Their radiance is about linear in w, so
that the straight line through them tells the triangle's own radiance at w = 1, and at w = 0 what is around. Beginning
at an emitter, a neighbour belongs to it if it has more than half of the step between the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.observations import Observations
from fipt.stages.emitters.regions import PIXELS, Surface, neighbours

_SIGMA = 2.0
"""Standard errors of its radiance by which a triangle must have more than half of the step."""
_LEAST_SPREAD = 1e-4
"""Variance of shares that are all alike: their deviation, 1 %, is well below what one ray of a pixel adds (6 %)."""


@dataclass(frozen=True)
class _ShareLines:
    """The line through the pixels of each of T triangles.

    Attributes
    ----------
    own, around, error
        (T, 3) radiance at w = 1, at w = 0, and the standard error of the first; own is -inf where too few pixels tell.
    pixels, view
        (T,) sum of w, and the view that has most of it.
    """

    own: np.ndarray
    around: np.ndarray
    error: np.ndarray
    pixels: np.ndarray
    view: np.ndarray


def grown(
    mesh: Mesh, surface: Surface, shards: Sequence[ObservedShard], label: np.ndarray
) -> tuple[np.ndarray, Observations]:
    """Let emitters grow over triangles of which no pixel tells by itself.

    Parameters
    ----------
    label
        (T,) int64 region whose light a triangle sends out, -1 where none.

    Returns
    -------
    label
        The same with these triangles.
    seen
        What the lines tell of them: as many pixels as their shares add up to.
    """
    emits, nothing = label >= 0, Observations.none()
    if not emits.any():
        return label, nothing
    pixel = float(np.median(surface.width[emits]))
    asked = ~emits & (surface.pixels < PIXELS) & (np.sqrt(mesh.areas) > pixel)  # smaller ones have the blur's rule
    pairs = neighbours(mesh)
    pairs = np.concatenate([pairs, pairs[::-1]], axis=1)
    pairs = pairs[:, asked[pairs[1]] & (asked | emits)[pairs[0]]]
    if not emits[pairs[0]].any():
        return label, nothing
    lines = _lines(shards, asked)
    own, around, error = (values.mean(axis=1) for values in (lines.own, lines.around, lines.error))
    bright, level = np.nan_to_num(surface.radiance.mean(axis=1)), np.zeros(surface.count)
    for region in np.unique(label[emits]):
        level[region] = np.median(bright[emits & (surface.region == region)])
    result = label.copy()
    while True:
        a, b = pairs[:, (result[pairs[0]] >= 0) & (result[pairs[1]] < 0)]
        region = result[a]
        joins = own[b] - _SIGMA * error[b] > 0.5 * (level[region] + around[b])
        if not joins.any():
            break
        result[b[joins]] = region[joins]
    joined = np.flatnonzero((result >= 0) & ~emits)
    each = np.repeat(joined, np.round(lines.pixels[joined]).astype(np.int64))
    zero = np.zeros(len(each))
    return result, Observations(
        each, lines.own[each].astype(np.float32), lines.view[each], zero, zero.astype(bool), zero.astype(np.int64)
    )


def _lines(shards: Sequence[ObservedShard], asked: np.ndarray) -> _ShareLines:
    """Lines of the triangles where ``asked`` (T,) is true, through all pixels that show any of them."""
    count = len(asked)
    sums, most, best, number = np.zeros((3, count)), np.zeros(count), np.zeros(count, np.int64), 0
    colors = np.zeros((3, count, 3))
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            triangle = np.asarray(samples.triangle[own])
            use = np.flatnonzero(asked[triangle] & (shard.weight[pixel] > 0))
            triangle, w = triangle[use], np.asarray(samples.weight[own])[use].astype(np.float64)
            c = shard.radiance[pixel[use]].astype(np.float64)
            for row, factor in enumerate((np.ones_like(w), w, w * w)):
                sums[row] += np.bincount(triangle, factor, count)
            for row, values in enumerate((c, w[:, None] * c, c * c)):
                colors[row] += np.stack([np.bincount(triangle, column, count) for column in values.T], axis=1)
            here = np.bincount(triangle, w, count)
            best[here > most] = number
            most, number = np.maximum(most, here), number + 1
    n = np.maximum(sums[0], 1)
    w, c = sums[1] / n, colors[0] / n[:, None]
    spread = np.maximum(sums[2] / n - w**2, 0)
    known = (sums[1] >= PIXELS) & (spread > _LEAST_SPREAD)
    spread = np.where(known, spread, 1.0)
    slope = (colors[1] / n[:, None] - w[:, None] * c) / spread[:, None]
    left = np.maximum(colors[2] / n[:, None] - c**2 - slope**2 * spread[:, None], 0)
    error = np.sqrt(left * (1 / n + (1 - w) ** 2 / (n * spread))[:, None])
    at_one, at_zero = c + slope * (1 - w)[:, None], np.maximum(c - slope * w[:, None], 0)
    return _ShareLines(np.where(known[:, None], at_one, -np.inf), at_zero, error, sums[1], best)
