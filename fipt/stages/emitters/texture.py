"""How much texture a region must have if it reflects: the light of a room is uneven, and paint follows it.

An emitter is as bright where the room's light is weak as where it is strong. To look like that, paint would have to be
darker exactly where more light falls on it. So what counts is how much more uneven the base colour of a region would be
than its radiance,

    x = ln(deviation of ln base colour / deviation of ln radiance)        between its pieces.

Ordinary surface has such an x > 0 too, by chance, and where shading is wrong. How often, this room's own regions say:
the share of them with x > 0, and a generalised Pareto distribution of these x, fitted by probability-weighted moments
(Hosking and Wallis 1987, Technometrics 29). Its shape tells a heavy tail, as wrong shading makes it; then little is
concluded from any x.
"""

from dataclasses import dataclass

import numpy as np

_FLOOR = 0.01
"""Deviation of log radiance added in quadrature: less is noise of a piece's median (0.1 of a pixel, 100 of them)."""
FEWEST = 6
"""Pieces that tell a deviation: with fewer it is itself off by half and more."""
_FEWEST_REGIONS = 30
"""Regions with x > 0 that tell how x is distributed; the error of the shape is 1.3 / sqrt(n)."""


@dataclass(frozen=True)
class TextureOdds:
    """Natural logarithm of how rare an x is among regions that reflect.

    Attributes
    ----------
    share
        Of regions with x > 0.
    scale, shape
        Of the generalised Pareto distribution of x > 0; shape >= 0.
    regions
        How many regions were compared; 0: too few to conclude anything.
    """

    share: float
    scale: float
    shape: float
    regions: int

    @staticmethod
    def of(x: np.ndarray) -> "TextureOdds":
        """From the x (N,) of regions that reflect."""
        above = np.sort(x[x > 0])
        count = len(above)
        if count < _FEWEST_REGIONS:
            return TextureOdds(1.0, 1.0, 0.0, 0)
        mean = float(above.mean())
        # mean of x (1 - F): a quarter of the mean of x for an exponential distribution
        weighted = float((above * (count - 0.65 - np.arange(count)) / count).mean())
        shape = max(2 - mean / (mean - 2 * weighted), 0.0)
        return TextureOdds(count / len(x), mean * (1 - shape), shape, len(x))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(N,) evidence against reflection, >= 0."""
        if self.regions == 0:
            return np.zeros_like(x)
        above = np.maximum(x, 0) / self.scale
        tail = above if self.shape < 1e-6 else np.log1p(self.shape * above) / self.shape
        return np.where(x > 0, tail - np.log(self.share), 0)


def deviation(values: np.ndarray, weight: np.ndarray, region: np.ndarray, regions: int) -> np.ndarray:
    """(R,) weighted standard deviation of logarithms (P,) between the pieces of each region; 0 with too few pieces.

    Parameters
    ----------
    weight, region
        (P,) pixels of each piece, and its region.
    """
    total = np.maximum(np.bincount(region, weight, regions), 1e-9)
    middle = np.bincount(region, weight * values, regions) / total
    variance = np.bincount(region, weight * (values - middle[region]) ** 2, regions) / total
    return np.sqrt(variance + _FLOOR**2) * (np.bincount(region, weight > 0, regions) >= FEWEST)
