"""How sure the part search is: probabilities of roughness and metallic for every part.

Of each pair (s, m) of the search's grid a residual R is left. It is compared with the least one:

    p(s, m) ~ prior(s, m) exp(-(R / R_min - 1) / t),      t = 0.02 + 0.5 / sqrt(pixels)

0.5 / sqrt(pixels) is the noise of the residual that the search itself allows for; 0.02 is what errors of the shading
leave of it however many pixels there are. The prior is that of the part's semantic class, the mean over the class's
parts, which starts from that of the room, which starts from nothing known (empirical Bayes): where a part shows
nothing, it may be anything that the room's other parts are.
"""

from dataclasses import dataclass

import numpy as np

from fipt.stages.fit.inner_pixels import FEWEST

_SYSTEMATIC = 0.02
"""Share of the residual that shading decides."""
_NOISE = 0.5
"""Of the residual, over the square root of its pixels: that of the search."""
_METAL = 0.1
"""Share of parts that are metal, before any is known."""
_ITERATIONS = 20


@dataclass(frozen=True)
class MaterialPosterior:
    """Probabilities by segment id.

    Attributes
    ----------
    levels
        (L,) roughnesses.
    probability
        (2, L, S) of dielectric and metal with each roughness; sums to 1 for a segment.
    """

    levels: np.ndarray
    probability: np.ndarray

    def roughness_error(self, segment: np.ndarray, roughness: np.ndarray) -> np.ndarray:
        """(N,) expected absolute error of fitted roughnesses (N,) of segments (N,)."""
        chance = self.probability.sum(axis=0)
        error = np.zeros(len(segment))
        for j, level in enumerate(self.levels):
            error += chance[j, segment] * np.abs(roughness - level)
        return error

    def metal(self, segment: np.ndarray) -> np.ndarray:
        """(N,) probability that segments (N,) are metal."""
        return self.probability[1].sum(axis=0)[segment]


def no_parts(levels: np.ndarray, count: int) -> MaterialPosterior:
    """What is known of ``count`` segments without a search: nothing."""
    return MaterialPosterior(levels, np.repeat(_nothing_known(levels)[:, :, None], count, axis=2))


def posterior(
    levels: np.ndarray, residual: np.ndarray, free: np.ndarray, classes: np.ndarray | None = None
) -> MaterialPosterior:
    """Probabilities of every segment.

    Parameters
    ----------
    levels
        (L,) roughnesses.
    residual
        (2, L, S) residuals of the search for dielectric and metal.
    free
        (S,) pixels that they were measured on; a segment with fewer than `FEWEST` has only its prior.
    classes
        (S,) semantic class of every segment, 0 = unknown; None: only the room is shared.
    """
    start, known = _nothing_known(levels), np.flatnonzero(free >= FEWEST)
    least = np.maximum(residual.min(axis=(0, 1)), 1e-9)
    excess = (residual / least - 1) / (_SYSTEMATIC + _NOISE / np.sqrt(np.maximum(free, 1)))
    likelihood = np.where(free >= FEWEST, np.exp(-excess), 1.0)
    names, owner = np.unique(np.zeros(len(free), int) if classes is None else classes, return_inverse=True)
    prior = np.repeat(start[:, :, None], len(names), axis=2)
    for _ in range(_ITERATIONS):
        probability = likelihood * prior[:, :, owner]
        probability /= probability.sum(axis=(0, 1))
        room = (probability[:, :, known].sum(axis=2) + start) / (len(known) + 1)
        for number, name in enumerate(names):
            own = known[owner[known] == number] if name > 0 else known[:0]
            prior[:, :, number] = (probability[:, :, own].sum(axis=2) + room) / (len(own) + 1)
    probability = likelihood * prior[:, :, owner]
    return MaterialPosterior(levels, probability / probability.sum(axis=(0, 1)))


def _nothing_known(levels: np.ndarray) -> np.ndarray:
    """(2, L): roughness is anything from 0 to 1 alike."""
    width = np.gradient(levels)
    return np.outer([1 - _METAL, _METAL], width / width.sum())
