"""Small bright spots in a view: what is several times as bright as all around it, and fills a few pixels.

A spot is the pixels around a peak that have half of its radiance, and one more around them, which a lens and the edges
of pixels blur it into. Its irradiance is what these have beyond the median around the peak.
"""

from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import binary_dilation, label, maximum_filter

from fipt.conventions import LUMINANCE
from fipt.scene.cameras import Camera

_TIMES = 3.0
"""A spot is so many times as bright as the median around it, and as three quarters of the view."""
_LEVEL = 75
"""Percentile of a view's luminance that stands for its lit surfaces."""
_WIDEST = 10
"""A window reaches a tenth of the view's longer side to each side of a spot, which fills a quarter of it at most."""
_UPPER = 0.75
"""Quantile of a spot's pixels: the median of the brighter half."""
_TRIED = 4
"""Peaks that are looked at for each spot that is kept at most, the brightest first: a bound on time."""


@dataclass(frozen=True)
class Spots:
    """N bright spots.

    Attributes
    ----------
    view
        (N,) int64 number of the view.
    center
        (N, 3) of its camera, metres.
    direction
        (N, 3) unit vectors to the middle of the spot's light.
    irradiance
        (N,) that the spot makes at the camera, on a plane that faces it: radiance times solid angle, of luminance.
    peak
        (N,) largest luminance in it, beyond what is around.
    level
        (N,) median of the brighter half of its pixels, beyond what is around: those at its edge are dim, and noise
        makes the brightest one brighter.
    pixel
        (N,) largest angle of a pixel of the view, radians.
    """

    view: np.ndarray
    center: np.ndarray
    direction: np.ndarray
    irradiance: np.ndarray
    peak: np.ndarray
    level: np.ndarray
    pixel: np.ndarray

    def __len__(self) -> int:
        """How many."""
        return len(self.view)

    def __getitem__(self, rows: np.ndarray) -> "Spots":
        return Spots(*(getattr(self, own.name)[rows] for own in fields(self)))

    @classmethod
    def joined(cls, parts: list["Spots"]) -> "Spots":
        """The spots of all views."""
        return cls(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(cls)))


def bright_spots(camera: Camera, radiance: np.ndarray, valid: np.ndarray, view: int, most: int) -> Spots:
    """Find the spots of a view, of those the ``most`` with the largest irradiance.

    Parameters
    ----------
    radiance, valid
        (H, W, 3) and (H, W) weights; pixels without any show nothing.
    view
        Its number.
    """
    luminance = np.where(valid > 0, radiance @ LUMINANCE, 0.0)
    half = max(max(luminance.shape) // _WIDEST, 4)
    shown = luminance[valid > 0]
    least = _TIMES * float(np.percentile(shown, _LEVEL)) if len(shown) else np.inf
    row, column = np.nonzero((luminance == maximum_filter(luminance, 3)) & (luminance > max(least, 0.0)))
    order = np.argsort(-luminance[row, column], kind="stable")[: _TRIED * most]
    taken = np.zeros(luminance.shape, bool)
    found = []
    for r, c in zip(row[order].tolist(), column[order].tolist(), strict=True):
        if not taken[r, c]:
            spot = _spot(luminance, valid > 0, taken, (r, c), half)
            found += [] if spot is None else [spot]
    found.sort(key=lambda spot: -spot[2])
    columns, rows, light, peak, level = np.array(found[:most], float).reshape(-1, 5).T
    directions = camera.directions(columns, rows).reshape(-1, 3).astype(np.float64)
    # a pixel off the axis is smaller, and seen aslant
    cosine = -directions @ camera.world_from_camera[:3, 2]
    number, center = np.full(len(rows), view), np.tile(camera.center, (len(rows), 1))
    solid_angle = cosine**3 / (camera.fx * camera.fy)
    return Spots(
        number, center, directions, light * solid_angle, peak, level, np.full(len(rows), 1 / min(camera.fx, camera.fy))
    )


def _spot(
    luminance: np.ndarray, known: np.ndarray, taken: np.ndarray, peak: tuple[int, int], half: int
) -> tuple[float, float, float, float, float] | None:
    """Column and row of the middle; sum, peak and level of what a spot has beyond what is around. None: it is no spot.

    Its pixels are ``taken`` (H, W) in any case. Pixels that are not ``known`` (H, W) cut it as the picture's side does.
    """
    low = np.maximum(np.array(peak) - half, 0)
    window = (slice(low[0], peak[0] + half + 1), slice(low[1], peak[1] + half + 1))
    near = luminance[window]
    bright, _ = label(near > luminance[peak] / 2, np.ones((3, 3)))
    own = bright == bright[tuple(np.array(peak) - low)]
    alone = not (taken[window] & own).any()
    taken[window] |= own
    grown, seen = binary_dilation(own, np.ones((3, 3))), known[window]
    around = float(np.median(near[seen]))
    cut = own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any()  # by the window, or the picture's side
    if cut or not seen[grown].all() or not alone or luminance[peak] < _TIMES * around or own.sum() > half**2:
        return None
    beyond = np.where(grown, np.maximum(near - around, 0), 0.0)
    rows, columns = np.mgrid[: near.shape[0], : near.shape[1]] + 0.5
    total = beyond.sum()
    column, row = (beyond * columns).sum() / total + low[1], (beyond * rows).sum() / total + low[0]
    level = float(np.quantile(near[own], _UPPER)) - around
    return float(column), float(row), float(total), float(luminance[peak]) - around, level
