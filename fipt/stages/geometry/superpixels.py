"""Pieces of an image that show one surface: alike in log radiance, and small."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import median_filter

from fipt.robust import deviation

_DARKEST = 0.01
"""Radiance that is added before the logarithm, in medians of the view: noise of dark pixels is no edge."""
_SIDES = 20
"""Superpixels along the longer side of an image, at least: a wall then has some hundred."""
_SCALE = 100.0
"""Of the graph segmentation, in deviations of noise: a piece of n pixels is cut where neighbours differ by more than
this over n beyond what they differ by within."""
_SMALLEST = 12
"""Pixels of the smallest segment: below, a plane has no room."""
_STEP = 0.03
"""Least difference of log radiance that parts segments: one percent, what the finest paper texture shows."""


@dataclass(frozen=True)
class Superpixels:
    """A view's superpixels.

    Attributes
    ----------
    label
        (H, W) int32 number of each pixel's superpixel.
    segment
        (H, W) int32 number of the segment that it was cut from, along the grid: what edges alone bound.
    pairs
        (E, 2) int64 numbers of superpixels that touch, the smaller first.
    contrast
        (E,) float64 median difference of log radiance across their border, of the channel that differs most.
    """

    label: np.ndarray
    segment: np.ndarray
    pairs: np.ndarray
    contrast: np.ndarray

    @property
    def count(self) -> int:
        """How many."""
        return int(self.label.max()) + 1

    @cached_property
    def neighbours(self) -> list[list[tuple[int, float]]]:
        """Of each superpixel, those that touch it, and the contrast."""
        result: list[list[tuple[int, float]]] = [[] for _ in range(self.count)]
        for (a, b), value in zip(self.pairs.tolist(), self.contrast.tolist(), strict=True):
            result[a].append((b, value))
            result[b].append((a, value))
        return result


def superpixels(radiance: np.ndarray) -> Superpixels:
    """Cut an (H, W, 3) image of linear radiance along its edges, and large pieces along a grid.

    Notes
    -----
    Felzenszwalb and Huttenlocher, Efficient graph-based image segmentation (IJCV 2004), as in OpenCV.
    """
    import cv2

    light = log_radiance(radiance)
    smooth = median_filter(light, size=(3, 3, 1))
    noise = max(float(deviation(light - smooth)), _STEP / 3)
    segmentation = cv2.ximgproc.segmentation.createGraphSegmentation(0.5, _SCALE, _SMALLEST)
    segment = segmentation.processImage((smooth / noise).astype(np.float32))
    side = max(segment.shape) / _SIDES
    row, column = (np.floor(np.arange(size) / side).astype(np.int64) for size in segment.shape)
    cell = segment.astype(np.int64) * 10_000 + row[:, None] * 100 + column[None, :]
    label = np.unique(cell, return_inverse=True)[1].reshape(segment.shape).astype(np.int32)
    return Superpixels(label, segment.astype(np.int32), *_borders(label, smooth))


def log_radiance(radiance: np.ndarray, middle: np.ndarray | None = None) -> np.ndarray:
    """(H, W, 3) float32 natural logarithm of radiance, each channel over its median, or over (3,) ``middle``."""
    if middle is None:
        middle = np.median(radiance.reshape(-1, 3), axis=0)
    middle = np.maximum(middle, 1e-12)
    return np.log(np.maximum(radiance, 0) / middle + _DARKEST).astype(np.float32)


def _borders(label: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of superpixels that touch, and contrast across each border."""
    count = int(label.max()) + 1
    keys, steps = [], []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        one, other = label[a].astype(np.int64), label[b].astype(np.int64)
        differ = one != other
        low, high = np.minimum(one, other)[differ], np.maximum(one, other)[differ]
        keys.append(low * count + high)
        steps.append(np.abs(light[a] - light[b]).max(axis=-1)[differ])
    key, step = np.concatenate(keys), np.concatenate(steps)
    order = np.lexsort((step, key))
    key, step = key[order], step[order]
    found, first, length = np.unique(key, return_index=True, return_counts=True)
    pairs = np.stack(np.divmod(found, count), axis=1) if len(found) else np.zeros((0, 2), np.int64)
    return pairs, step[first + length // 2].astype(np.float64)
