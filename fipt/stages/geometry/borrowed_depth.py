"""Depth that the border of a bare segment has from what lies beside it.

Windows of stereo reach over edges. Beside a table, the floor has the table's depth; a bare floor has no other. Planes
would take it from there for all of the floor.
"""

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.patch_match import REACH
from fipt.stages.geometry.superpixels import Superpixels

_BARE = 0.25
"""A segment is bare if known pixels are so rare inside, out of reach of its border, in units of those on its border."""
_LEAST = 12
"""Pixels inside that a segment must have to be called bare: of fewer, chance may know none."""


def borrowed(view: DepthView, pieces: Superpixels) -> np.ndarray:
    """(H, W) bool: pixels of bare segments whose windows reach over the segment's border."""
    segment, side = pieces.segment, 2 * REACH + 1
    border = maximum_filter(segment, side) != minimum_filter(segment, side)
    count = int(segment.max()) + 1

    def of_segment(pixels: np.ndarray) -> np.ndarray:
        return np.bincount(segment[pixels], minlength=count)

    inside, known = of_segment(~border), view.map.known
    within = of_segment(known & ~border) / np.maximum(inside, 1)
    around = of_segment(known & border) / np.maximum(of_segment(border), 1)
    bare = (inside >= _LEAST) & (within < _BARE * around)
    found: np.ndarray = border & bare[segment]
    return found
