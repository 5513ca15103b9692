"""HDR views to 8-bit images in which dark corners show as many features as bright walls."""

import cv2
import numpy as np

from fipt.conventions import LUMINANCE

_DARKEST = 0.01
"""Of the median luminance: what is darker is mostly noise, and is compressed."""
_CONTRAST, _TILES = 3.0, 8
"""Limit of the local contrast, and tiles along each side that have their own."""
_RIM = 4
"""Pixels beside a masked one that are not used either: the mask's own edge would be a feature."""


def local_contrast(radiance: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(H, W) uint8 image of (H, W, 3) linear radiance: logarithm of the luminance, contrast evened out by tiles.

    Parameters
    ----------
    radiance
        >= 0 but for noise.
    shown
        (H, W) bool; the range is that of these pixels.
    """
    luminance = np.maximum(radiance @ np.array(LUMINANCE, np.float32), 0)
    seen = luminance[shown & (luminance > 0)]
    if not seen.size:
        return np.zeros(luminance.shape, np.uint8)
    stops = np.log2(luminance + _DARKEST * float(np.median(seen)))
    low, high = np.percentile(stops[shown], (0.5, 99.8))
    # 16 bits here: a tile's contrast may be raised several times over.
    values = np.clip((stops - low) / max(high - low, 1e-6), 0, 1) * 65535
    even = cv2.createCLAHE(clipLimit=_CONTRAST, tileGridSize=(_TILES, _TILES))
    return (even.apply(values.astype(np.uint16)) >> 8).astype(np.uint8)


def mask(shown: np.ndarray) -> np.ndarray:
    """(H, W) uint8, 255 where features may lie: what is shown, without its rim."""
    return cv2.erode(shown.astype(np.uint8) * 255, np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8))
