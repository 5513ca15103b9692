"""Samples as images: the n-th samples of all pixels form a layer, so that image filters apply."""

import numpy as np

from fipt.render.denoise import denoise
from fipt.scene.samples import FootprintSamples

_FEWEST = 0.01
"""Share of the pixels below which a layer is too sparse to be an image: its samples stay as they are."""


def denoise_samples(values: np.ndarray, samples: FootprintSamples, index: int, quality: str = "high") -> np.ndarray:
    """Denoise (N, K, 3) values of a view's samples as K images a layer.

    The n-th samples of all pixels form the n-th layer; pixels without an n-th sample show their last one, so that each
    image is complete. Pixels that miss the mesh are black.
    """
    height, width = samples.shapes[index]
    pixels, own = samples.pixels(index), samples.of_view(index)
    first = np.asarray(samples.offsets[pixels]) - own.start
    counts = np.diff(samples.offsets[pixels.start : pixels.stop + 1])
    covered = (counts > 0)[:, None]
    normal = np.asarray(samples.normal[own])
    result = values.copy()
    for number in range(int(counts.max(initial=0))):
        has = counts > number
        if has.mean() < _FEWEST:
            break
        chosen = np.where(counts > 0, first + np.minimum(number, np.maximum(counts - 1, 0)), 0)
        guide = np.where(covered, normal[chosen], 0.0).reshape(height, width, 3)
        for output in range(values.shape[1]):
            image = np.where(covered, values[chosen, output], 0.0).reshape(height, width, 3)
            clean = denoise(image, normal=guide, quality=quality).reshape(-1, 3)
            result[chosen[has], output] = clean[has]
    return result
