"""Pixels that are brighter than any reflection: more of them than in the round before show that light is missing."""

import numpy as np

from fipt.model.reflectance import brightest_reflection
from fipt.scene.observed import fully_weighted
from fipt.scene.samples import ALONE, FootprintSamples
from fipt.scene.shading import Shading

_TOLERANCE = 0.1
"""Relative error of light that is tolerated."""


def more_brighter(
    samples: FootprintSamples,
    index: int,
    shading: tuple[Shading, Shading],
    pixels: tuple[np.ndarray, np.ndarray, np.ndarray],
    emitting: np.ndarray,
) -> tuple[float, int]:
    """By what share of the pixels of view number ``index`` more are brighter than any reflection than before.

    Parameters
    ----------
    shading
        Of all samples: of this round, and of the one before.
    pixels
        (P, 3) radiance, (P,) weight, and (P,) bool whether the radiance is only a lower bound.
    emitting
        Triangles that emit: their pixels are no reflection.

    Returns
    -------
        That share, and how many pixels were judged.
    """
    radiance, weight, clipped = pixels
    own, pixel = samples.of_view(index), samples.pixel_of_sample(index)
    use = (np.asarray(samples.weight[own]) >= ALONE) & (fully_weighted(weight) & ~clipped)[pixel]
    use = np.flatnonzero(use & ~np.isin(np.asarray(samples.triangle[own]), emitting))
    if len(use) == 0:
        return 0.0, 0
    bright, rows = radiance[pixel[use]].mean(axis=1), use + own.start
    now, before = (bright > (1 + _TOLERANCE) * brightest_reflection(np.asarray(each[rows])) for each in shading)
    return float(now.mean() - before.mean()), len(use)
