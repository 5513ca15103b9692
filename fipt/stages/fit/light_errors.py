"""Errors of the traced light that vary slowly over a part: they are taken off before the fit.

A lamp that is missing, or a little off, makes the base colours of a wall change slowly from place to place. All views
agree on it, so that they cannot tell it from texture; but texture varies on a small scale, too. For every part that is
no metal, with l the logarithm of the base colour that a voxel's pixels suggest, its mean over the channels:

    low     mean of l around, by a Gaussian of `_SIGMA` voxels
    slow    variance of low about its median;  fast  that of l about low
    error   (1 - fast / (2 slow)) (low - its median), or 0 where fast is more than twice slow

Texture is taken to vary half as much slowly as it does fast; the rest of the slow variance is light, and the error its
best linear estimate (Wiener). The traced light times exp(error) gives the part one brightness. An error of all of a
part stays. A part that the Gaussian covers at once tells nothing: a picture on a wall has its own bright half.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from fipt.conventions import DARK_BASE_COLOR
from fipt.scene.voxels import voxel_keys

RESOLUTION = 96
"""Voxels along the scene box."""
_SIGMA = 3.0
"""Standard deviation of the Gaussian, voxels."""
_REACH = 3.0
"""How many of these it reaches."""
_AROUND = 0.25
"""Weight of the voxels around one, of that in the middle of a plane, below which it stands alone and tells nothing."""
_SLOW = 0.5
"""Variance that texture has slowly, of what it has fast."""
_FEWEST = round(np.pi * (_REACH * _SIGMA) ** 2)
"""Voxels of a part of which something is known: those of a plane that the Gaussian reaches."""
_MOST = 1.0
"""Logarithms that a voxel's brightness counts away from its part's, at most: hardly any light was traced there."""
_ROWS = 4096
"""Voxels whose surroundings are in memory at a time."""
_IDS = 1 << 16
"""Part ids that a voxel may have."""


@dataclass(frozen=True)
class LightErrors:
    """Logarithms of the light that is there over the traced light, by voxel and part, about the median of each part.

    Attributes
    ----------
    center, side
        The scene box, metres.
    key
        (K,) int64 of voxel and part, ascending.
    error
        (K,) float64.
    """

    center: np.ndarray
    side: float
    key: np.ndarray
    error: np.ndarray

    @property
    def size(self) -> float:
        """Root of the mean square of the errors, logarithms; 0 where nothing is known."""
        return float(np.sqrt(np.mean(self.error**2))) if len(self.error) else 0.0

    def factor(self, points: np.ndarray, segment: np.ndarray) -> np.ndarray:
        """(N,) float32 factor of the light traced at points (N, 3) of parts (N,); 1 where nothing is known.

        Between the centres of voxels it is interpolated, over those that are known.
        """
        if len(self.key) == 0:
            return np.ones(len(points), np.float32)
        place = (points - (self.center - self.side / 2)) * (RESOLUTION / self.side) - 0.5
        first = np.floor(place)
        total, known = np.zeros(len(points)), np.zeros(len(points))
        for corner in product((0, 1), repeat=3):
            weight = np.abs(1 - np.array(corner) - (place - first)).prod(axis=1)
            cell = np.clip(first + corner, 0, RESOLUTION - 1).astype(np.int64)
            key = ((cell[:, 2] * RESOLUTION + cell[:, 1]) * RESOLUTION + cell[:, 0]) * _IDS + segment
            row = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
            weight *= self.key[row] == key
            total += weight * self.error[row]
            known += weight
        return np.exp(total / np.maximum(known, 1e-6)).astype(np.float32)


def cells_of(points: np.ndarray, segment: np.ndarray, center: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """(K,) keys of the voxels of parts that points (N, 3) of parts (N,) lie in, ascending, and (N,) which of them."""
    key, cell = np.unique(voxel_keys(points, center, side, RESOLUTION) * _IDS + segment, return_inverse=True)
    return key, cell.reshape(-1)


def measured(key: np.ndarray, base_color: np.ndarray, use: np.ndarray, center: np.ndarray, side: float) -> LightErrors:
    """The errors that base colours tell.

    Parameters
    ----------
    key
        (K,) voxels of parts, as of `cells_of`.
    base_color
        (K, 3) that the pixels there suggest; more than 1 where light is missing.
    use
        (K,) bool: those of dielectric parts that have enough pixels. Where the colour is 0 no light was traced.
    """
    part, voxel = key % _IDS, key // _IDS
    grid = np.stack([voxel % RESOLUTION, voxel // RESOLUTION % RESOLUTION, voxel // RESOLUTION**2], axis=1)
    level = np.log(np.maximum(base_color, 0) + DARK_BASE_COLOR).mean(axis=1)
    error, use = np.full(len(key), np.nan), use & (base_color.max(axis=1) > 0)
    for k in np.unique(part[use]):
        own = np.flatnonzero(use & (part == k))
        if len(own) >= _FEWEST:
            error[own] = _slow(grid[own].astype(np.float64), level[own])
    known = np.isfinite(error)
    return LightErrors(center, side, key[known], error[known])


def _slow(place: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(M,) error of the light in the voxels (M, 3) of one part, of brightness ``level`` (M,); NaN where few are around.

    A voxel does not count for its own surroundings, or what stands alone would vary slowly.
    """
    middle = np.median(level)
    level = np.clip(level, middle - _MOST, middle + _MOST)
    tree, low, weight = cKDTree(place), np.zeros(len(level)), np.zeros(len(level))
    for first in range(0, len(level), _ROWS):
        rows = slice(first, first + _ROWS)
        near = cKDTree(place[rows]).sparse_distance_matrix(tree, _REACH * _SIGMA, output_type="coo_matrix").tocsr()
        near.data = np.exp(-0.5 * (near.data / _SIGMA) ** 2)
        weight[rows] = np.asarray(near.sum(axis=1)).ravel() - 1
        low[rows] = near @ level - level[rows]
    known = weight >= _AROUND * 2 * np.pi * _SIGMA**2
    result = np.full(len(level), np.nan)
    if np.count_nonzero(known) >= _FEWEST:
        low = low[known] / weight[known]
        off = low - np.median(low)
        slow, fast = np.mean(off**2), np.mean((level[known] - low) ** 2)
        result[known] = max(1 - _SLOW * fast / max(slow, 1e-12), 0) * off
    return result
