"""8-bit and 16-bit PNG, what else OpenCV decodes, and the sRGB curve."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fipt.errors import FiptError, unreadable
from fipt.formats.files import atomic, existing_file

if TYPE_CHECKING:
    from PIL.Image import Image

_MOST_PIXELS = 10**9
"""Pixels of an image that is read: cameras have a tenth of that, panoramas that are stitched perhaps half."""

_SMALLEST_MSE = 1e-10


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Apply the sRGB curve to linear values >= 0; it goes on above 1, nothing is clipped there."""
    linear = np.maximum(linear, 0.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-8) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """Invert `srgb_encode`."""
    encoded = np.asarray(encoded)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def to_display(linear: np.ndarray) -> np.ndarray:
    """Return linear radiance or reflectance of any shape as uint8: clipped to [0, 1], sRGB curve."""
    return (srgb_encode(np.clip(linear, 0.0, 1.0)) * 255.0 + 0.5).astype(np.uint8)


def psnr_of_error(mse: float) -> float:
    """Peak signal-to-noise ratio for peak 1, dB, of a mean squared error; 100 dB, not infinity, of none."""
    return float(-10.0 * np.log10(max(mse, _SMALLEST_MSE)))


def write_png(path: str | Path, pixels: np.ndarray) -> None:
    """Write an (H, W[, 3]) uint8 image or an (H, W) uint16 id map as PNG."""
    from PIL import Image

    with atomic(path) as temporary:
        Image.fromarray(pixels).save(temporary)


def read_pixels(path: str | Path, what: str, mode: str | None = None) -> np.ndarray:
    """Read an image of 8 or 16 bits; ``mode`` is that of Pillow to convert to, such as ``L``.

    Raises
    ------
    FiptError
        If it is missing, cut, of another format, or of more pixels than any camera has.
    """
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = _MOST_PIXELS  # Pillow warns from there on, and refuses twice as many
    existing_file(path, what)
    try:
        with Image.open(path) as image:
            if image.width * image.height > _MOST_PIXELS:  # before anything is decoded
                raise ValueError(f"{image.width}x{image.height} pixels, at most {_MOST_PIXELS:,} are read")
            return np.array(image if mode is None else image.convert(mode))
    except Exception as error:  # each decoder raises its own kinds
        raise unreadable(path, error, f"is not a readable image ({error})", "replace the file") from error


def is_deep(path: str | Path) -> bool:
    """Whether a file is a PNG of 16 bits a channel; most readers cut those of colour images to 8."""
    with Path(path).open("rb") as file:
        head = file.read(25)
    return head[:8] == b"\x89PNG\r\n\x1a\n" and head[24:] == b"\x10"


def as_rgb(image: "Image") -> np.ndarray:
    """(H, W, 3) values from 0 to 1 of an image of Pillow, which would clip grey of 16 bits at 255."""
    if image.mode.startswith("I;16"):
        return np.repeat(np.asarray(image)[..., None] / 65535.0, 3, axis=2)
    return np.asarray(image.convert("RGB")) / 255.0


def read_ids(path: str | Path) -> np.ndarray:
    """Read an id map: (H, W) uint16, 0 = unknown."""
    ids = read_pixels(path, "an id map")
    if ids.size == 0 or ids.dtype == bool or ids.ndim != 2 or ids.min() < 0 or ids.max() > 65535:
        raise FiptError(f"{path} must be a grey PNG with ids from 0 to 65535", "export it as a 16-bit grey PNG")
    return ids.astype(np.uint16)


def decoded(path: str | Path, flags: int) -> np.ndarray | None:
    """Read an image by OpenCV (flags ``cv2.IMREAD_*``); None where it cannot, without OpenCV's own lines on stderr."""
    import cv2

    data = np.frombuffer(Path(path).read_bytes(), np.uint8)
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_FATAL)
    try:
        return cv2.imdecode(data, flags)
    except cv2.error:  # an empty file
        return None
    finally:
        cv2.utils.logging.setLogLevel(level)
