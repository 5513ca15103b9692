"""Parts from materials: regions of the surface that the pictures show to be of one material become one part.

Regions that were grown on the mesh end where they should, but there are far too many of them: a chair is ten. Each
region, the best known first, joins the material that it agrees with best, or is the first of a new one. It agrees with
a material where

- base colours differ by no more than noise: the squared difference of each channel over its variance, summed, stays
  below the 95 % quantile of chi square. The variance is that of pieces of one region, which holds texture and the error
  of the shading, which is much larger in brightness than in hue;
- one roughness and metallic explains both: it leaves more unexplained than the best of each alone by no more than
  three standard errors, as the differences of pieces tell.
"""

from collections.abc import Sequence

import numpy as np

from fipt.scene.observed import ObservedShard
from fipt.scene.samples import scene_box
from fipt.stages.segment.material_evidence import HALF, MaterialEvidence, measure
from fipt.stages.segment.region_pixels import region_pixels

_CHI_SQUARE = 7.815
"""95 % quantile of chi square with three degrees of freedom."""
_STANDARD_ERRORS = 3.0
"""Standard errors by which one trial must be worse than another; the best of many is often two better by chance."""


def regrouped(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]) -> tuple[list[np.ndarray], int]:
    """Regions of pixels to parts of pixels.

    Parameters
    ----------
    regions
        Per shard: (P,) uint16 region of each pixel, 0 = unknown.

    Returns
    -------
    parts
        Per shard: (P,) uint16 part of each pixel. What no pixel tells stays a part of its own.
    materials
        How many parts are of regions that pixels tell.
    """
    pixels = region_pixels(shards, regions)
    known, place = np.unique(pixels.region, return_inverse=True)
    present = np.unique(np.concatenate([np.unique(own) for own in regions]))
    part_of = np.zeros(int(present.max(initial=0)) + 1, np.uint16)
    materials = 0
    if len(known):
        center, side = scene_box([shard.samples for shard in shards])
        label = joined(measure(pixels, place.reshape(-1), len(known), center, side))
        materials = int(label.max()) + 1
        part_of[known] = label + 1
    others = present[(part_of[present] == 0) & (present > 0)]
    part_of[others] = materials + 1 + np.arange(len(others))
    return [part_of[own] for own in regions], materials


def joined(evidence: MaterialEvidence) -> np.ndarray:
    """(R,) int64 material of each region, from 0 in the order in which they are founded."""
    count = len(evidence.pixels)
    label = np.zeros(count, np.int64)
    left, products = np.zeros_like(evidence.left), np.zeros_like(evidence.products)
    color, pixels = np.zeros_like(evidence.color), np.zeros(count)
    metal = np.zeros(count, bool)
    variance = np.zeros_like(evidence.variance)
    materials = 0
    for k in np.argsort(-evidence.pixels, kind="stable"):
        like = np.flatnonzero(metal[:materials] == evidence.metal[k])
        trials = slice(HALF, None) if evidence.metal[k] else slice(None, HALF)
        best = (left[like, trials] + evidence.left[k, trials]).argmin(axis=1) + trials.indices(2 * HALF)[0]
        off = color[like, best] - evidence.color[k, best]
        distance = (off**2 / (variance[like] + evidence.variance[k])).sum(axis=1)
        near = distance < _CHI_SQUARE
        like, best, distance = like[near], best[near], distance[near]
        agrees = ~_worse(left[like], products[like], best, trials)
        same = np.zeros(len(like), np.int64) + k
        agrees &= ~_worse(evidence.left[same], evidence.products[same], best, trials)
        if agrees.any():
            own = like[agrees][distance[agrees].argmin()]
        else:
            own, materials = materials, materials + 1
            metal[own] = evidence.metal[k]
        label[k] = own
        share = evidence.pixels[k] / (pixels[own] + evidence.pixels[k])
        color[own] += share * (evidence.color[k] - color[own])
        left[own], products[own] = left[own] + evidence.left[k], products[own] + evidence.products[k]
        variance[own] = (1 - share) ** 2 * variance[own] + share**2 * evidence.variance[k]
        pixels[own] += evidence.pixels[k]
    return label


def _worse(left: np.ndarray, products: np.ndarray, trial: np.ndarray, trials: slice) -> np.ndarray:
    """(K,) bool: a trial (K,) is clearly worse than the best of ``trials``, by evidence (K, T) and (K, T, T)."""
    rows = np.arange(len(left))
    own = left[:, trials].argmin(axis=1) + trials.indices(2 * HALF)[0]
    more = left[rows, trial] - left[rows, own]
    square = products[rows, own, own] + products[rows, trial, trial] - 2 * products[rows, own, trial]
    return more > _STANDARD_ERRORS * np.sqrt(np.maximum(square, 0))
