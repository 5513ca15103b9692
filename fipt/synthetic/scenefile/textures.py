"""Textures of a scene file as arrays: pictures, checkerboards, constants."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.hdr import read_hdr
from fipt.formats.images import decoded, is_deep, srgb_decode
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.values import COLORS, color, transform
from fipt.synthetic.scenefile.xml import Node

log = logging.getLogger(__name__)

_AS_IT_IS = np.eye(3)[:2]
_DRAWN = 64
"""Texels along the side of a drawn pattern."""
_GREY = 0.5
"""What stands in for a texture that is missing."""


@dataclass(frozen=True)
class Map:
    """Values over the surface.

    Attributes
    ----------
    values
        (h, w, 3) float32; (1, 1, 3) where they are constant; row 0 is v = 0.
    from_uv
        (2, 3) matrix from the surface's (u, v, 1) to the map's coordinates.
    alpha
        (h, w) float32 opacity of the picture, where it has one.
    picture
        Name of the picture, if it is one.
    flagged
        Whether it stands in for a missing file or an unknown plugin.
    """

    values: np.ndarray
    from_uv: np.ndarray
    alpha: np.ndarray | None = None
    image: str = ""
    flagged: bool = False

    @property
    def constant(self) -> bool:
        """Whether it is the same everywhere."""
        return self.values.shape[:2] == (1, 1)

    @property
    def mean(self) -> np.ndarray:
        """(3,) float64 mean over the map."""
        return self.values.mean(axis=(0, 1), dtype=np.float64)

    @property
    def grey(self) -> np.ndarray:
        """(h, w) float32 luminance."""
        return (self.values @ np.array(LUMINANCE)).astype(np.float32)

    def with_values(self, values: np.ndarray) -> Map:
        """Return a map in the same place with other values, (h, w, 3) or (h, w)."""
        if values.ndim == 2:
            values = np.repeat(values[..., None], 3, axis=2)
        return replace(self, values=values.astype(np.float32), alpha=None)


def constant(value: float | np.ndarray) -> Map:
    """Return a map of one value, a number or (3,)."""
    return Map(np.broadcast_to(np.asarray(value, np.float32), (1, 1, 3)).copy(), _AS_IT_IS)


def read_map(node: Node | None, default: float, source: SceneFileReader, light: bool = False) -> Map:
    """Read a property that may be a number, a colour or a texture; ``default`` where it is absent."""
    if node is None:
        return constant(default)
    if node.tag in COLORS:
        return constant(color(node, light))
    if node.tag != "texture":
        raise node.wrong(f"{node.name or node.tag} must be a number, a colour or a texture; found <{node.tag}>")
    if node.type == "bitmap":
        return _bitmap(node, source)
    if node.type in ("checkerboard", "gridtexture"):
        return _pattern(node, source)
    if node.type == "scale":
        inner = next((child for child in node.children if child.name != "scale"), None)
        found, factor = read_map(inner, default, source, light), node.get("scale")
        return found.with_values(found.values * np.asarray(1.0 if factor is None else color(factor, light), np.float32))
    if node.type in ("uniform", "rgb", "srgb", "constant", "d65", "blackbody"):
        return constant(color(replace(node, tag="spectrum"), light))
    source.refuse(node, f"texture {node.type}")
    return replace(constant(_GREY), flagged=True)


def _placed(node: Node) -> np.ndarray:
    """(2, 3) matrix of `Map.from_uv`: Mitsuba 3's ``to_uv``, or scale and offset of older versions."""
    found = node.get("to_uv")
    if found is not None:
        return transform(found)[np.ix_([0, 1], [0, 1, 3])]
    both = node.number("uvscale", 1.0)
    scale = [node.number("uscale", both), node.number("vscale", both)]
    return np.column_stack([np.diag(scale), [node.number("uoffset", 0.0), node.number("voffset", 0.0)]])


def _pattern(node: Node, source: SceneFileReader) -> Map:
    """A checkerboard, or a grid of lines."""
    first = read_map(node.get("color0"), 0.4 if node.type == "checkerboard" else 0.2, source).mean
    second = read_map(node.get("color1"), 0.2 if node.type == "checkerboard" else 0.4, source).mean
    place = (np.arange(_DRAWN) + 0.5) / _DRAWN
    if node.type == "checkerboard":
        chosen = (place[:, None] > 0.5) != (place[None] > 0.5)
    else:
        width = node.number("line_width", 0.01)
        line = (place < width) | (place > 1 - width)
        chosen = line[:, None] | line[None]
    values = np.where(chosen[..., None], second, first)
    return Map(values.astype(np.float32), _placed(node))


# --- pictures -------------------------------------------------------------------------------------


def _bitmap(node: Node, source: SceneFileReader) -> Map:
    path = source.file(node.get("filename"))
    if path is None:
        return replace(constant(_GREY), flagged=True, image=node.text("filename"))
    gamma = 1.0 if node.flag("raw", False) else node.number("gamma", -1.0)
    try:
        values, alpha, size = _image(path, gamma, source.settings.max_texture)
    except FiptError as error:
        source.note(str(error))
        source.refuse(node, f"picture {path.name}, which cannot be read")
        return replace(constant(_GREY), flagged=True, image=path.name)
    if size != values.shape[:2]:
        source.note(
            f"texture {path.name}: {size[1]}x{size[0]} averaged down to {values.shape[1]}x{values.shape[0]} "
            "(max_texture)"
        )
    return Map(values, _placed(node), alpha, path.name)


@lru_cache(maxsize=4)
def _image(path: Path, gamma: float, most: int) -> tuple[np.ndarray, np.ndarray | None, tuple[int, int]]:
    """Read a picture.

    Parameters
    ----------
    gamma
        Of the encoding of pictures of 8 or 16 bits; 1 = linear, -1 = the sRGB curve. OpenEXR and .hdr are linear.
    most
        Texels along the longer side; larger pictures are averaged, after decoding.

    Returns
    -------
    values
        (h, w, 3) float32 linear.
    alpha
        (h, w) float32, or None where the picture is opaque.
    size
        (height, width) in the file.
    """
    if path.suffix.lower() in (".exr", ".hdr"):
        pixels, table = _float_image(path), None
    else:
        pixels = _encoded_image(path)
        steps = np.linspace(0, 1, np.iinfo(pixels.dtype).max + 1)
        table = (srgb_decode(steps) if gamma <= 0 else steps**gamma).astype(np.float32)
    size = pixels.shape[:2]
    color = shrunk(pixels[..., :3], most, table)
    if pixels.shape[2] == 3:
        return color, None, size
    plain = None if table is None else np.linspace(0, 1, len(table), dtype=np.float32)
    alpha = shrunk(pixels[..., 3:], most, plain)[..., 0]
    return color, alpha if alpha.min() < 1 else None, size


def _float_image(path: Path) -> np.ndarray:
    if path.suffix.lower() == ".hdr":
        pixels = read_hdr(path)
    else:
        channels = read_exr(path)
        names = [name for name in "RGBA" if name in channels]
        if names[:3] != list("RGB"):
            grey = [name for name in channels if name != "A"] or list(channels)
            if len(grey) != 1:
                raise FiptError(
                    f"{path} must have the channels R, G and B, or one besides A; it has {', '.join(channels)}",
                    "write the colour as R, G, B",
                )
            names = grey * 3
        pixels = np.stack([channels[name] for name in names], axis=-1)
    wrong = ~(np.isfinite(pixels) & (pixels >= 0))
    if wrong.any():
        log.warning("%s: %d of %d values are negative or not finite; they count as 0", path, wrong.sum(), wrong.size)
    return np.where(wrong, 0, pixels)


def _encoded_image(path: Path) -> np.ndarray:
    """(h, w, 3 or 4) uint8, or uint16 of a PNG or of grey of 16 bits."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            with Image.open(path) as image:
                if is_deep(path):
                    image.load()  # which tells what is wrong with the file
                    return _deep_image(path)
                # To RGB, Pillow would clip grey of more than 8 bits at 255; of PGM files it calls 16 bits I.
                if image.mode.startswith("I;16") or (image.mode, image.format) == ("I", "PPM"):
                    return np.repeat(np.asarray(image).astype(np.uint16)[..., None], 3, axis=2)
                if image.mode in ("I", "F"):
                    raise ValueError("it has 32 bits a channel; write 8 or 16 bits, or OpenEXR")
                clear = "A" in image.getbands() or "transparency" in image.info
                return np.asarray(image.convert("RGBA" if clear else "RGB"))
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise FiptError(f"{path} is not a readable picture ({error})", "replace the file") from error


def _deep_image(path: Path) -> np.ndarray:
    """(h, w, 3 or 4) uint16, which Pillow cuts to 8 bits."""
    import cv2

    found = decoded(path, cv2.IMREAD_UNCHANGED)
    if found is None:
        raise ValueError("OpenCV does not read it")
    return np.repeat(found[..., None], 3, axis=2) if found.ndim == 2 else found[..., [2, 1, 0, 3][: found.shape[2]]]


def shrunk(pixels: np.ndarray, most: int, table: np.ndarray | None) -> np.ndarray:
    """Decode with a ``table`` of all values and average blocks until the longer side has at most ``most`` texels.

    A strip of rows at a time: huge pictures never exist as floats.
    """
    height, width = pixels.shape[:2]
    factor = max(height, width) / most
    if factor <= 1:
        return (pixels if table is None else table[pixels]).astype(np.float32)
    rows, columns = (np.linspace(0, n, max(round(n / factor), 1) + 1).astype(int) for n in (height, width))
    out = np.empty((len(rows) - 1, len(columns) - 1, pixels.shape[2]), np.float32)
    for k, (top, bottom) in enumerate(pairwise(rows)):
        strip = pixels[top:bottom] if table is None else table[pixels[top:bottom]]
        total = np.add.reduceat(strip.sum(axis=0, dtype=np.float64), columns[:-1], axis=0)
        out[k] = total / ((bottom - top) * np.diff(columns))[:, None]
    return out
