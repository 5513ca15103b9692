"""Pixels that one part fills: what the search for materials of whole parts reads, grouped into pieces of a part."""

from dataclasses import dataclass

import numpy as np

from fipt.conventions import SHADING_OUTPUTS
from fipt.model.reflectance import exceeds_reflection
from fipt.scene.observed import filled_by_one, full_pixels
from fipt.scene.samples import scattered
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.fit.batches import Pixels

FEWEST = 4
"""Pixels that a piece must have; with fewer the base colour explains anything."""
_MOST_PIXELS = 400_000
"""Pixels used at most, or less than twice as many: a part's two numbers do not need more."""


@dataclass(frozen=True)
class InnerPixels:
    """N pixels that one segment fills: radiance, place, normal (N, 3), shading (N, outputs, 3), segment, view (N,)."""

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    segment: np.ndarray
    view: np.ndarray


def stride(pixels: int) -> int:
    """Of so many training pixels one in ``stride`` is used."""
    return max(pixels // _MOST_PIXELS, 1)


def inner_pixels(pixels: Pixels, emitter_gain: float) -> InnerPixels:
    """Pixels that samples of one known segment fill, emitters left out.

    A part that is nowhere smooth over a whole pixel has no other pixels.
    """
    step = stride(len(pixels))
    parts, passed, views = [], 0, 0
    for number, shard in enumerate(pixels.shards):
        use = full_pixels(shard, pixels.valid[number]) & ~pixels.clipped[number]
        filled = np.flatnonzero((np.diff(shard.offsets) > 0) & use)
        chosen = filled[scattered(passed, len(filled), step)]
        passed += len(filled)
        first_view, views = views, views + len(shard.views)
        if len(chosen) == 0:
            continue
        chosen, own, segment, shading = filled_by_one(
            shard,
            pixels.shading[number],
            chosen,
            lambda pixel, sample, at=number: pixels.segment_of(np.full(len(sample), at), pixel, sample),
        )
        radiance = np.asarray(pixels.radiance[number][chosen], np.float32)
        view = first_view + np.searchsorted(shard.first_pixels, chosen, side="right") - 1
        keep = ~exceeds_reflection(radiance, shading, emitter_gain) & (segment > 0)
        arrays = (radiance, shading, shard.position[own], shard.normal[own], segment, view)
        parts.append([array[keep] for array in arrays])
    if not parts:
        rows, ids = np.zeros((0, 3), np.float32), np.zeros(0, np.int64)
        return InnerPixels(rows, np.zeros((0, SHADING_OUTPUTS, 3), np.float32), rows, rows, ids, ids)
    return InnerPixels(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def pieces_of(inner: InnerPixels, resolution: int, center: np.ndarray, side: float) -> tuple[np.ndarray, int]:
    """(N,) piece of each pixel: voxel, segment and the axis its normal is nearest to; and their number."""
    record = voxel_keys(inner.place, center, side, resolution) * FACINGS + facings(inner.normal)
    _, piece = np.unique(record * 65536 + inner.segment, return_inverse=True)
    return piece.reshape(-1), int(piece.max(initial=-1)) + 1


def encoded_weight(radiance: np.ndarray) -> np.ndarray:
    """(N, 3) weight that makes a squared error of radiance (N, 3) about one of sRGB-encoded radiance."""
    return (radiance + 0.05) ** -1.2


def best_base_color(
    radiance: np.ndarray,
    offset: np.ndarray,
    slope: np.ndarray,
    group: np.ndarray,
    groups: int,
    weight: np.ndarray | None = None,
) -> np.ndarray:
    """(G, 3) base colour that explains the rows of each group best, not clipped.

    ``weight`` (N, 3) is that of the rows' squared errors; None: `encoded_weight`.
    """
    weight = encoded_weight(radiance) if weight is None else weight
    base = np.empty((groups, 3))
    for c in range(3):
        w = weight[:, c] * slope[:, c]
        over = np.bincount(group, w * (radiance[:, c] - offset[:, c]), groups)
        base[:, c] = over / np.maximum(np.bincount(group, w * slope[:, c], groups), 1e-9)
    return base
