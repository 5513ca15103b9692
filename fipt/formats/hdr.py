"""Radiance RGBE images (.hdr): the usual form of environment maps beside OpenEXR. OpenCV decodes them."""

from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.formats.images import decoded


def read_hdr(path: str | Path) -> np.ndarray:
    """Read a .hdr image whose rows go from top to bottom, flat or run-length coded.

    Returns
    -------
    (height, width, 3) float32 linear RGB.

    Raises
    ------
    FiptError
        If the file is missing, damaged or of another kind.
    """
    import cv2

    image = decoded(existing_file(path, "a .hdr image"), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR_RGB)
    if image is None or image.dtype != np.float32:
        raise FiptError(
            f"{path} is not a readable .hdr image (RGBE with rows from top to bottom)", "convert it to OpenEXR"
        )
    return image
