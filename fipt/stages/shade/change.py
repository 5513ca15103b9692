"""What a refinement changed, told apart from its noise, and how much of the shading before it is kept.

Two estimates of the same shading, x of the round before and y of this one, differ by noise and by what the round has
learnt. Noise of different views is independent; what was learnt is the same for all views of a surface. So for the
difference d = ln y - ln x of diffuse shading, with its mean in each view of a small piece of surface,

    c^2 = mean product of the means of two different views          what was learnt
    D   = mean of d^2 over samples,      v = (D - c^2) / 2          noise of x, and of y

If y has no bias, and x the bias c, then (1 - k) y + k x is best with k = v / D = (1 - c^2 / D) / 2: the mean of both
where they differ by noise alone, y alone where all views agree that x was wrong.

It has a bias where emitters are missing: then less arrives than the photographs show, in all views alike, and fits make
up for it by base colours near white. What tells is surface that is brighter than white under y, and not under x.
Nothing is taken from such a round.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fipt.model.reflectance import brightest_reflection
from fipt.scene.samples import ALONE, FootprintSamples, scene_box
from fipt.scene.settled import ShadingChange
from fipt.scene.shading import Shading
from fipt.scene.voxels import FACINGS, facings, voxel_keys

_PIECES = 96
"""Pieces along the scene box, as in the search for parts: several pixels of several views each."""
_MOST = 1.0
"""Differences count up to here, a factor of 2.7: corners into which no light falls have no logarithm."""
_DARKEST = 1e-4
"""Radiance below which shading counts as black."""
_TOLERANCE = 0.1
"""Relative error of light that is tolerated, and share of the pixels that may be brighter than white."""
_SIGMAS = 3.0
"""Standard errors, from the scatter over views, by which that share must grow."""


def keep_share(
    samples: FootprintSamples, new: Shading, old: Shading, damping: float, whole: bool = False
) -> ShadingChange:
    """Join the shading of a shard with that of the round before, in place; say what changed.

    Parameters
    ----------
    new, old
        Of all H samples; ``new`` becomes the mean of both.
    damping
        Share of ``old`` to keep, were their difference noise alone.
    whole
        Keep all of it, since light is missing in ``new``.
    """
    views = [samples.of_view(index) for index in range(len(samples.views))]
    diffuse = [np.concatenate([each[own][:, 0].mean(axis=1) for own in views]) for each in (new, old)]
    found = measure_change(samples, diffuse[0], diffuse[1], damping)
    found = replace(found, kept=1.0, light_missing=1.0) if whole else found
    if found.kept > 0:
        for own in views:
            new[own] = (1 - found.kept) * new[own] + found.kept * old[own]
    return found


def measure_change(samples: FootprintSamples, new: np.ndarray, old: np.ndarray, damping: float) -> ShadingChange:
    """Compare two estimates of the diffuse shading of a shard.

    Parameters
    ----------
    new, old
        (H,) mean radiance of Ld over the channels.
    damping
        Share of ``old`` to keep, were the difference noise alone.
    """
    dark = (new < _DARKEST) & (old < _DARKEST)
    ratio = np.log(np.maximum(new, _DARKEST) / np.maximum(old, _DARKEST))
    d, weight = np.clip(ratio, -_MOST, _MOST), np.where(dark, 0, np.asarray(samples.weight, np.float64))
    if weight.sum() == 0:
        return ShadingChange(0.0, 0.0, damping, 0)
    every = float(np.average(d * d, weights=weight))
    learnt = min(max(_across_views(samples, d, weight), 0.0), every)
    kept = damping * (1 - learnt / every) if every > 0 else damping
    return ShadingChange(learnt**0.5, ((every - learnt) / 2) ** 0.5, kept, len(d))


def _across_views(samples: FootprintSamples, d: np.ndarray, weight: np.ndarray) -> float:
    """Mean product of the means of d (H,) in two views of a piece of surface; 0 where no piece has two views."""
    center, side = scene_box([samples])
    surface = voxel_keys(np.asarray(samples.position), center, side, _PIECES) * FACINGS
    surface += facings(np.asarray(samples.normal))
    own = [samples.of_view(index) for index in range(len(samples.views))]
    view = np.repeat(np.arange(len(own)), [part.stop - part.start for part in own])
    key, group = np.unique(surface * len(own) + view, return_inverse=True)
    total = np.bincount(group, weight)
    mean = np.bincount(group, weight * d) / np.maximum(total, 1e-12)
    _, piece = np.unique(key // len(own), return_inverse=True)
    seen = (total > 0).astype(np.float64)
    views, covered = np.bincount(piece, seen), np.bincount(piece, total)
    pairs = views > 1
    if not pairs.any():
        return 0.0
    product = np.bincount(piece, mean) ** 2 - np.bincount(piece, mean**2)
    return float(np.average(product[pairs] / (views * (views - 1))[pairs], weights=covered[pairs]))


def light_is_missing(
    samples: FootprintSamples,
    new: Shading,
    old: Shading,
    views: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]],
    emitting: np.ndarray,
) -> bool:
    """Whether many more pixels are brighter than any reflection under the new shading than under the old.

    Parameters
    ----------
    views
        Of every view: (P, 3) radiance, (P,) weight, and (P,) bool whether the radiance is only a lower bound.
    emitting
        Triangles that emit: their pixels are no reflection.
    """
    more = []
    for index, (radiance, weight, clipped) in enumerate(views):
        own, pixel = samples.of_view(index), samples.pixel_of_sample(index)
        use = (np.asarray(samples.weight[own]) >= ALONE) & (weight[pixel] > ALONE) & ~clipped[pixel]
        use = np.flatnonzero(use & ~np.isin(np.asarray(samples.triangle[own]), emitting))
        if len(use) == 0:
            continue
        bright, rows = radiance[pixel[use]].mean(axis=1), use + own.start
        over = [bright > (1 + _TOLERANCE) * brightest_reflection(np.asarray(each[rows])) for each in (new, old)]
        more.append(over[0].mean() - over[1].mean())
    if len(more) < 2:
        return False
    return bool(np.mean(more) - _SIGMAS * np.std(more, ddof=1) / len(more) ** 0.5 > _TOLERANCE)
