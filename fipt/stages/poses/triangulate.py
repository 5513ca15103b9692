"""Points from their pixels in several views with known cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fipt.scene.cameras import Camera

_PAIRS = 60
"""Pairs of views tried as a start, at most."""

_INLIER = 3.0
"""Residual in pixels up to which an observation counts, whatever the others have."""


@dataclass(frozen=True)
class Triangulated:
    """A point in space.

    Attributes
    ----------
    position
        (3,) float64, in the frame of the cameras.
    residual
        (N,) pixels between each observation and the point's projection.
    used
        (N,) bool: observations that agree.
    parallax
        Largest angle between two of the rays that agree, degrees.
    """

    position: np.ndarray
    residual: np.ndarray
    used: np.ndarray
    parallax: float


def triangulate(cameras: Sequence[Camera], pixels: np.ndarray) -> Triangulated:
    """Find the point that (N, 2) pixels in N >= 2 cameras show; single wrong observations are left out.

    The start is the pair of views whose point the others agree with best; the result minimises the squared reprojection
    errors of those that agree.
    """
    from scipy.optimize import least_squares

    pixels = np.asarray(pixels, np.float64)
    centers = np.array([camera.center for camera in cameras])
    rays = np.array([camera.directions(*pixel) for camera, pixel in zip(cameras, pixels, strict=True)], np.float64)

    def errors(point: np.ndarray, which: np.ndarray) -> np.ndarray:
        return np.concatenate([cameras[i].project(point[None])[0][0] - pixels[i] for i in which])

    def residuals(point: np.ndarray) -> np.ndarray:
        return np.hypot(*errors(point, np.arange(len(cameras))).reshape(-1, 2).T)

    every = list(combinations(range(len(cameras)), 2))
    pairs = sorted(every, key=lambda pair: rays[pair[0]] @ rays[pair[1]])[:_PAIRS]
    starts = [nearest_point(centers[list(pair)], rays[list(pair)]) for pair in pairs]
    start = min(starts, key=lambda point: np.median(residuals(point)))
    limit = max(_INLIER, 3 * float(np.median(residuals(start))))
    used = residuals(start) <= limit
    if used.sum() < 2:
        used[:] = True
    found = least_squares(errors, start, args=(np.flatnonzero(used),), x_scale="jac").x
    cosines = rays[used] @ rays[used].T
    return Triangulated(found, residuals(found), used, float(np.degrees(np.arccos(np.clip(cosines.min(), -1, 1)))))


def nearest_point(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(3,) point with the least squared distance to lines through (N, 3) origins along (N, 3) unit directions."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    # Of parallel lines no point is nearest: the pseudo-inverse gives one of them.
    return np.linalg.pinv(across.sum(axis=0), hermitian=True) @ (across @ origins[:, :, None]).sum(axis=0)[:, 0]
