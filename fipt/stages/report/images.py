"""Images for the page: tone mapped, coloured, scaled down and embedded as data URIs."""

import base64
import io
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.formats.images import srgb_encode, to_display

DIFFERENCE_RANGE = 0.25
"""Difference of sRGB-encoded values that has the last colour of the difference map."""

_QUALITY = 90
"""Of the embedded WebP images."""


@dataclass(frozen=True)
class EmbeddedImage:
    """One embedded image.

    Attributes
    ----------
    key
        Column it belongs to.
    label
        Short heading.
    src
        Data URI.
    width, height
        Pixels of the embedded image.
    """

    key: str
    label: str
    src: str
    width: int
    height: int


def surface_map(values: np.ndarray, hit: np.ndarray | None, encode: bool) -> np.ndarray:
    """Return a map over the surface as (H, W, 4) uint8, transparent where there is no surface.

    Parameters
    ----------
    values
        (H, W) or (H, W, 3) in [0, 1].
    hit
        (H, W), positive where the pixel's centre hits the mesh; everything is opaque where absent.
    encode
        Apply the sRGB curve (colours); False for numbers such as roughness, shown as grey in
        proportion.
    """
    values = np.nan_to_num(values)
    pixels = to_display(values) if encode else np.uint8(np.clip(values, 0, 1) * 255 + 0.5)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    alpha = np.full(pixels.shape[:2], 255, np.uint8)
    if hit is not None:
        alpha[hit <= 0] = 0
    return np.dstack([pixels, alpha])


def difference_map(render: np.ndarray, photo: np.ndarray, exposure: float) -> np.ndarray:
    """Colour the mean absolute difference of two (H, W, 3) radiance images as shown; uint8.

    Both are exposed, clipped and sRGB encoded first; black is no difference, the brightest colour
    `DIFFERENCE_RANGE` or more.
    """
    shown = [srgb_encode(np.clip(np.nan_to_num(p * exposure), 0, 1)) for p in (render, photo)]
    return error_map(np.abs(shown[0] - shown[1]).mean(axis=-1))


def error_map(size: np.ndarray) -> np.ndarray:
    """Colour errors (H, W) of values as shown, uint8: from black for none to that of `DIFFERENCE_RANGE` or more."""
    from matplotlib import colormaps

    return colormaps["inferno"](np.clip(size / DIFFERENCE_RANGE, 0, 1), bytes=True)[..., :3]


def swatch(radiance: Iterable[float]) -> str:
    """Return the colour of an emitter as ``#rrggbb``: its radiance divided by the largest channel."""
    rgb = np.maximum(np.asarray(list(radiance), np.float64), 0.0)
    peak = rgb.max(initial=0.0)
    red, green, blue = to_display(rgb / peak if peak > 0 else np.zeros(3))
    return f"#{red:02x}{green:02x}{blue:02x}"


def embedded(pixels: np.ndarray, width: int) -> tuple[str, int, int]:
    """Return an image as a data URI (WebP), its width and height; wider ones are scaled down.

    Parameters
    ----------
    pixels
        (H, W, 3) or (H, W, 4) uint8.
    width
        Largest width, pixels.
    """
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(pixels))
    if image.width > width:
        size = (width, max(1, round(image.height * width / image.width)))
        image = image.resize(size, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=_QUALITY, method=5)
    text = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f"data:image/webp;base64,{text}", image.width, image.height


def data_uri(path: Path, kind: str, most: int) -> str | None:
    """Return a file of a media type as a data URI; None if it has more than ``most`` bytes."""
    if path.stat().st_size > most:
        return None
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def packed(content: bytes) -> str:
    """Return bytes, compressed (zlib), as base64 text; ``unpacked`` of data.js reads it."""
    return base64.b64encode(zlib.compress(content)).decode("ascii")
