"""Work on colour mosaics: values by position, bad pixels, demosaicing."""

from __future__ import annotations

import cv2
import numpy as np

_DEMOSAIC = {
    "RGGB": cv2.COLOR_BayerRGGB2RGB_EA,
    "BGGR": cv2.COLOR_BayerBGGR2RGB_EA,
    "GRBG": cv2.COLOR_BayerGRBG2RGB_EA,
    "GBRG": cv2.COLOR_BayerGBRG2RGB_EA,
}
"""OpenCV's edge-aware method; it takes 8 and 16 bits only."""


def pattern_name(pattern: np.ndarray) -> str:
    """Name of a (2, 2) pattern of colour indices: ``RGGB`` for example."""
    return "".join("RGBG"[index] for index in pattern.ravel())


def tiled(values: np.ndarray, pattern: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Spread (4,) values by colour index over a mosaic: (rows, columns) of the values' type."""
    cell = np.asarray(values)[pattern]
    return np.tile(cell, ((rows + 1) // 2, (columns + 1) // 2))[:rows, :columns]


def demosaic(mosaic: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """Interpolate the missing colours along edges: (H, W) uint16 -> (H, W, 3) uint16 RGB."""
    # Two reflected pixels keep the pattern's phase and give the border its neighbours.
    padded = cv2.copyMakeBorder(mosaic, 2, 2, 2, 2, cv2.BORDER_REFLECT_101)
    return cv2.demosaicing(padded, _DEMOSAIC[pattern_name(pattern)])[2:-2, 2:-2]


def replace_bad_pixels(mosaic: np.ndarray, bad_pixels: np.ndarray) -> None:
    """Replace bad pixels by the mean of the good ones of their colour next to them, in place.

    Parameters
    ----------
    mosaic
        (H, W) uint16.
    bad_pixels
        (N, 2) int rows and columns.
    """
    if not len(bad_pixels):
        return
    height, width = mosaic.shape
    bad = np.zeros(mosaic.shape, bool)
    bad[tuple(bad_pixels.T)] = True
    total, count = np.zeros(len(bad_pixels)), np.zeros(len(bad_pixels))
    for row_step, column_step in ((-2, 0), (2, 0), (0, -2), (0, 2), (-2, -2), (-2, 2), (2, -2), (2, 2)):
        row, column = bad_pixels[:, 0] + row_step, bad_pixels[:, 1] + column_step
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        row, column = np.where(inside, row, 0), np.where(inside, column, 0)
        good = inside & ~bad[row, column]
        total += np.where(good, mosaic[row, column], 0)
        count += good
    known = count > 0
    mosaic[tuple(bad_pixels[known].T)] = np.rint(total[known] / count[known]).astype(np.uint16)
