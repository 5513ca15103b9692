"""Photo-consistency: of the views that show a place, how many see the radiance there that this view sees.

A bare surface tells stereo nothing, but where a plane puts a chair onto the wall behind it, other views see the wall's
colour in that place (Seitz and Dyer 1999).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from fipt.robust import deviation
from fipt.stages.geometry.depth_views import DepthView, pixels_of
from fipt.stages.geometry.superpixels import log_radiance

_VIEWS = 16
"""Other views that are asked, the nearest ones and others spread evenly: of more, few show the place."""
_ALIKE = 3.0
"""Deviations of log radiance, of one surface in two views, by which it may differ."""
_LEAST = 0.05
"""Deviation that is assumed at least: gloss and interpolation make as much where stereo knows nothing."""
_SAMPLES = 2_000
"""Known pixels of a view whose radiance is compared with that of others."""
_COMPARED = 4
"""Nearest other views that it is compared with."""
_SAME = 0.01
"""Share of its depth by which a place may differ in two views, to be one."""


@dataclass(frozen=True)
class Radiances:
    """Log radiance of all views, on one scale.

    Attributes
    ----------
    views
        The views.
    light
        Of each, (H, W, 3) float32 natural logarithm of radiance, without noise of single pixels; NaN where a pixel is
        black, as masked ones are.
    tolerance
        By which one surface differs between two views, at most.
    """

    views: Sequence[DepthView]
    light: Sequence[np.ndarray]
    tolerance: float

    @staticmethod
    def of(views: Sequence[DepthView]) -> "Radiances":
        """Take logarithms, and measure by how much surface of known depth differs between views."""
        middle = np.median([np.median(view.radiance.reshape(-1, 3), axis=0) for view in views], axis=0)
        light = [_smooth(view.radiance, middle) for view in views]
        off = [np.zeros(0)]
        for number, view in enumerate(views):
            row, column = np.nonzero(view.map.known)
            step = max(1, len(row) // _SAMPLES)
            row, column = row[::step], column[::step]
            for other in _asked(views, number)[:_COMPARED]:
                there_row, there_column, depth, inside = pixels_of(views[other].camera, view.points[row, column])
                there = views[other].map.depth[there_row, there_column]
                same = inside & (np.abs(there - depth) < _SAME * depth)
                differ = light[number][row, column] - light[other][there_row, there_column]
                off.append(differ[same].ravel())
        values = np.concatenate(off)
        values = values[np.isfinite(values)]
        found = float(deviation(values)) if len(values) else 0.0
        return Radiances(views, light, _ALIKE * max(found, _LEAST))

    def agreement(
        self, number: int, row: np.ndarray, column: np.ndarray, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """How many views agree that pixels lie on planes, and how many show the place.

        Parameters
        ----------
        number
            Of the view whose pixels they are.
        row, column
            (N,) pixels.
        slopes
            (P, 3) planes, see `RoomPlanes.slopes`.

        Returns
        -------
        agree, show
            (N, P) float32 each.
        """
        view, own = self.views[number], self.light[number][row, column][:, None]
        inverse = view.rays[row, column] @ slopes.T
        before = inverse > 1e-3
        points = view.camera.center + view.rays[row, column][:, None] / np.where(before, inverse, 1.0)[..., None]
        agree, show = np.zeros(inverse.shape, np.float32), np.zeros(inverse.shape, np.float32)
        for other in _asked(self.views, number):
            there_row, there_column, _, inside = pixels_of(self.views[other].camera, points.reshape(-1, 3))
            there = self.light[other][there_row, there_column].reshape(*inverse.shape, 3)
            seen = inside.reshape(inverse.shape) & before & np.isfinite(there[..., 0])
            alike = np.abs(there - own).max(axis=-1) < self.tolerance
            show += seen
            agree += seen & alike
        return agree, show


def _smooth(radiance: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32 log radiance over (3,) ``middle``, medians of 3x3 pixels; NaN where the pixel is black."""
    light = median_filter(log_radiance(radiance, middle), size=(3, 3, 1))
    return np.where((radiance > 0).any(axis=-1, keepdims=True), light, np.nan).astype(np.float32)


def _asked(views: Sequence[DepthView], number: int) -> list[int]:
    """Views that are asked about a view's pixels: the nearest half of them, and of the others some, evenly."""
    away = np.array([np.linalg.norm(view.camera.center - views[number].camera.center) for view in views])
    near = [int(other) for other in np.argsort(away, kind="stable") if other != number]
    rest = near[_VIEWS // 2 :]
    return near[: _VIEWS // 2] + rest[:: max(1, -(-len(rest) // (_VIEWS // 2)))]
