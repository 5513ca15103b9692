"""Images cut into square blocks of pixels; what does not fill a block, right and below, is left out."""

import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED


def blocks(values: np.ndarray, factor: int) -> np.ndarray:
    """(H, W[, C]) values as (h, factor, w, factor[, C]): h x w blocks of ``factor`` x ``factor`` pixels."""
    height, width = (n // factor for n in values.shape[:2])
    used = values[: height * factor, : width * factor]
    return used.reshape(height, factor, width, factor, *values.shape[2:])


def block_mean(values: np.ndarray, factor: int) -> np.ndarray:
    """Average (H, W[, C]) values over ``factor`` x ``factor`` pixels; (h, w[, C]) float32."""
    return blocks(values, factor).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def block_flags(flags: np.ndarray, factor: int) -> np.ndarray:
    """(h, w) uint32 flags of blocks: those of any of their (H, W) pixels, but for noise.

    Noise averages out, so most of a block must be below it. The others spoil a block by a single pixel.
    """
    found = np.bitwise_or.reduce(np.bitwise_or.reduce(blocks(flags.astype(np.uint32), factor), axis=3), axis=1)
    noisy = block_mean(flags.astype(np.uint32) & FLAG_NOISE > 0, factor) > 0.5
    return np.where(noisy, found | np.uint32(FLAG_NOISE), found & ~np.uint32(FLAG_NOISE)).astype(np.uint32)


def block_radiance(radiance: np.ndarray, valid: np.ndarray, flags: np.ndarray, factor: int) -> np.ndarray:
    """(h, w, 3) float32 mean radiance of blocks: by the (H, W) weights of their pixels.

    It is the plain mean where no pixel has weight, and where the (H, W) ``flags`` make a lower bound of a block: by
    weight, a clipped pixel would stand for all that have none.
    """
    weight = block_mean(valid, factor)
    weighted = block_mean(radiance * valid[..., None], factor) / np.where(weight > 0, weight, 1.0)[..., None]
    plain = (weight == 0) | is_bound(block_flags(flags, factor))
    return np.where(plain[..., None], block_mean(radiance, factor), weighted).astype(np.float32)


def is_bound(flags: np.ndarray) -> np.ndarray:
    """(H, W) bool: where the radiance is a lower bound, since the pixel is clipped and nothing else."""
    return (flags & FLAG_SATURATED > 0) & (flags & (FLAG_OUTSIDE | FLAG_MOVED) == 0)


def block_ids(ids: np.ndarray, factor: int) -> np.ndarray:
    """(h, w) uint16 ids that most of the (H, W) pixels of each block have, the smallest of equals."""
    pixels = blocks(ids, factor).swapaxes(1, 2)
    each = np.sort(pixels.reshape(*pixels.shape[:2], -1), axis=-1)
    counts = np.zeros(each.shape, np.int32)
    for index in range(each.shape[-1]):
        counts[..., index] = (each == each[..., index : index + 1]).sum(axis=-1)
    most = counts.argmax(axis=-1)[..., None]
    return np.take_along_axis(each, most, axis=-1)[..., 0].astype(np.uint16)
