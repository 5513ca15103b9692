"""Pixels that one part fills: what the search for materials of whole parts reads, grouped into pieces of a part."""

from dataclasses import dataclass

import numpy as np

from fipt.conventions import SHADING_OUTPUTS
from fipt.model.reflectance import exceeds_reflection
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.fit.batches import Pixels

FEWEST = 4
"""Pixels that a piece must have; with fewer the base colour explains anything."""
_MOST_PIXELS = 400_000
"""Pixels used at most: a part's two numbers do not need more."""


@dataclass(frozen=True)
class InnerPixels:
    """N pixels that one segment fills: radiance, place, normal (N, 3), shading (N, outputs, 3), segment, view (N,)."""

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    segment: np.ndarray
    view: np.ndarray


def inner_pixels(pixels: Pixels, emitter_gain: float) -> InnerPixels:
    """Pixels that samples of one known segment fill, emitters left out.

    Radiance is linear in shading, and one segment has one material here: the samples of such a pixel count as one with
    the weighted mean of their shading. A part that is nowhere smooth over a whole pixel has no other pixels.
    """
    step = max(len(pixels) // _MOST_PIXELS, 1)
    parts, passed, views = [], 0, 0
    for number, shard in enumerate(pixels.shards):
        use = (pixels.valid[number] > 0.99) & ~pixels.clipped[number]
        filled = np.flatnonzero((np.diff(shard.offsets) > 0) & use)
        chosen = filled[-passed % step :: step]  # the same ones however the views are spread over shards
        passed += len(filled)
        first_view, views = views, views + len(shard.views)
        if len(chosen) == 0:
            continue
        chosen, own, segment, shading = _of_one_segment(pixels, number, chosen)
        radiance = np.asarray(pixels.radiance[number][chosen], np.float32)
        view = first_view + np.searchsorted(shard.first_pixels, chosen, side="right") - 1
        keep = ~exceeds_reflection(radiance, shading, emitter_gain) & (segment > 0)
        arrays = (radiance, shading, shard.position[own], shard.normal[own], segment, view)
        parts.append([array[keep] for array in arrays])
    if not parts:
        rows, ids = np.zeros((0, 3), np.float32), np.zeros(0, np.int64)
        return InnerPixels(rows, np.zeros((0, SHADING_OUTPUTS, 3), np.float32), rows, rows, ids, ids)
    return InnerPixels(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _of_one_segment(
    pixels: Pixels, number: int, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Those of ``chosen`` pixels of a shard that one segment fills.

    Returns
    -------
    pixel, first, segment
        (N,) int64 pixel, its first sample, their segment.
    shading
        (N, outputs, 3) mean over its samples.
    """
    shard = pixels.shards[number]
    first = np.asarray(shard.offsets[chosen])
    count = np.asarray(shard.offsets[chosen + 1]) - first
    starts = np.cumsum(count) - count
    sample = np.repeat(first - starts, count) + np.arange(count.sum())
    segment = pixels.segment_of(np.full(len(sample), number), np.repeat(chosen, count), sample)
    one = np.minimum.reduceat(segment, starts) == np.maximum.reduceat(segment, starts)
    keep = np.repeat(one, count)
    chosen, first, count, sample = chosen[one], first[one], count[one], sample[keep]
    weight = np.asarray(shard.weight[sample], np.float32)
    starts = np.cumsum(count) - count
    if len(starts) == 0:
        return chosen, first, first, np.zeros((0, SHADING_OUTPUTS, 3), np.float32)
    weight /= np.repeat(np.add.reduceat(weight, starts), count)
    shading = pixels.shading[number][sample].astype(np.float32, copy=False)
    shading = np.add.reduceat(shading * weight[:, None, None], starts, axis=0)
    return chosen, first, segment[keep][starts], shading


def pieces_of(inner: InnerPixels, resolution: int, center: np.ndarray, side: float) -> tuple[np.ndarray, int]:
    """(N,) piece of each pixel: voxel, segment and the axis its normal is nearest to; and their number."""
    record = voxel_keys(inner.place, center, side, resolution) * FACINGS + facings(inner.normal)
    _, piece = np.unique(record * 65536 + inner.segment, return_inverse=True)
    return piece.reshape(-1), int(piece.max(initial=-1)) + 1


def best_base_color(
    radiance: np.ndarray,
    offset: np.ndarray,
    slope: np.ndarray,
    group: np.ndarray,
    groups: int,
    trust: np.ndarray | float = 1.0,
) -> np.ndarray:
    """(G, 3) base colour that explains the rows of each group best, not clipped; ``trust`` (N,) weighs them."""
    weight = (radiance + 0.05) ** -1.2  # about the squared slope of the sRGB curve
    base = np.empty((groups, 3))
    for c in range(3):
        w = trust * weight[:, c] * slope[:, c]
        over = np.bincount(group, w * (radiance[:, c] - offset[:, c]), groups)
        base[:, c] = over / np.maximum(np.bincount(group, w * slope[:, c], groups), 1e-9)
    return base
