"""RAW files: the mosaic with its black and white levels, and what the camera wrote about the shot."""

from __future__ import annotations

import io
import logging
import math
from calendar import timegm
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file

RAW_SUFFIXES = frozenset(
    f".{name}"
    for name in (
        *("3fr", "arw", "cr2", "cr3", "crw", "dcr", "dng", "erf", "fff", "iiq", "kdc", "mef", "mos", "mrw", "nef"),
        *("nrw", "orf", "pef", "raf", "raw", "rw2", "rwl", "sr2", "srf", "srw", "x3f"),
    )
)
LDR_SUFFIXES = frozenset({".jpg", ".jpeg", ".png"})
MERGED_SUFFIXES = frozenset({".exr", ".hdr"})
_D65 = 21
"""EXIF's number of the illuminant of linear sRGB."""
USUAL = {"shutter": (1e-7, 1e5), "aperture": (0.1, 1e3), "iso": (0.1, 1e8)}
"""Seconds, f-numbers and ISO speeds that cameras have; what is beyond is not known."""


@dataclass(frozen=True)
class Shot:
    """What is known of one photograph before its pixels are read.

    Attributes
    ----------
    path
        The file.
    shutter
        Exposure time in seconds as the camera states it (nominal); None where it states none.
    aperture, iso, focal_length, focal_length_35
        F-number, ISO speed, focal length in millimetres and its equivalent on 36 x 24 mm; None where unknown.
    camera, lens, serial
        Names as the camera writes them; None where unknown.
    time
        Start of the shot in seconds since 1970 by the camera's clock, with subseconds; None where unknown.
    orientation
        EXIF orientation, 1 to 8. Pixels stay in the sensor's frame whatever it says.
    """

    path: Path
    shutter: float | None = None
    aperture: float | None = None
    iso: float | None = None
    focal_length: float | None = None
    focal_length_35: float | None = None
    camera: str | None = None
    lens: str | None = None
    serial: str | None = None
    time: float | None = None
    orientation: int = 1

    @property
    def seconds(self) -> float:
        """The stated exposure time; FiptError where the file states none."""
        if self.shutter is None:
            raise _no_exposure_time(self.path)
        return self.shutter


@dataclass
class RawFrame:
    """The visible mosaic of a RAW file, untouched.

    Attributes
    ----------
    mosaic
        (H, W) uint16 raw values.
    pattern
        (2, 2) colour index of each position of the mosaic's cell: 0 red, 1 green, 2 blue, 3 second green.
    black
        (4,) float64 black level by colour index, raw units; may be fractional.
    white
        (4,) float64 raw value by colour index at which the sensor is full.
    white_balance
        (3,) float64 gains of red, green, blue that the camera measured or was set to, green = 1; None if it has none.
    camera_from_xyz
        (3, 3) float64 colour matrix of the camera, CIE XYZ under D65; None where LibRaw and the file know none.
    shot
        Its metadata.
    """

    mosaic: np.ndarray
    pattern: np.ndarray
    black: np.ndarray
    white: np.ndarray
    white_balance: np.ndarray | None
    camera_from_xyz: np.ndarray | None
    shot: Shot

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.mosaic.shape

    @property
    def range(self) -> np.ndarray:
        """(4,) float64 span from black to white by colour index."""
        return self.white - self.black


def read_raw(path: str | Path, shot: Shot | None = None) -> RawFrame:
    """Read a RAW file's visible mosaic, its levels and metadata; the file is read once.

    Parameters
    ----------
    path
        The RAW file.
    shot
        Its metadata if known already (from a table, say), else read from the file.

    Raises
    ------
    FiptError
        If it is not a RAW file, is truncated, holds no 2x2 colour mosaic or does not state an exposure time.
    """
    import rawpy

    path = existing_file(path, "a RAW file")
    data = path.read_bytes()
    raw = rawpy.RawPy()
    try:
        raw.open_buffer(io.BytesIO(data))
        raw.unpack()
        tags = _tags(io.BytesIO(data))
        frame = _frame(path, raw, tags, shot or _shot(path, tags, raw))
    except rawpy.LibRawFileUnsupportedError as error:
        raise FiptError(f"{path} is not a RAW file that LibRaw reads", "leave it out or convert it to DNG") from error
    except rawpy.LibRawError as error:
        raise FiptError(f"{path} is truncated or damaged ({_text(error)})", "copy it from the card again") from error
    except NotImplementedError as error:  # rawpy's, of mosaics that it does not know
        raise FiptError(
            f"{path} must have a colour mosaic that repeats every 2x2 pixels ({error})", "convert it to DNG"
        ) from error
    finally:
        raw.close()
    if not frame.shot.shutter:
        raise _no_exposure_time(path)
    return frame


def read_shot(path: str | Path) -> Shot:
    """Read only the metadata of a photograph (RAW, JPEG, PNG); RAW files must state an exposure time.

    Raises
    ------
    FiptError
        If a RAW file is none, or states no exposure time.
    """
    path = existing_file(path, "a photograph")
    with path.open("rb") as file:
        tags = _tags(file)
    shot = _shot(path, tags, None)
    if shot.shutter or path.suffix.lower() not in RAW_SUFFIXES:
        return shot
    # What exifread does not find, LibRaw may (CR3 and others); it costs more, so it comes second.
    import rawpy

    try:
        with rawpy.RawPy() as raw:
            raw.open_file(str(path))
            shot = _shot(path, tags, raw)
    except rawpy.LibRawError as error:
        raise FiptError(f"{path} is not a RAW file that LibRaw reads", "leave it out or convert it to DNG") from error
    if not shot.shutter:
        raise _no_exposure_time(path)
    return shot


def _frame(path: Path, raw: Any, tags: dict[str, Any], shot: Shot) -> RawFrame:
    import rawpy

    if raw.raw_type != rawpy.RawType.Flat or raw.raw_pattern is None or raw.raw_image_visible.ndim != 2:
        raise FiptError(
            f"{path} holds no colour mosaic (sRAW, mRAW or linear RAW)",
            "photograph in full RAW; these files are demosaiced already",
        )
    if raw.raw_pattern.shape != (2, 2):
        rows, columns = raw.raw_pattern.shape
        raise FiptError(
            f"{path} must have a colour mosaic that repeats every 2x2 pixels; found {rows}x{columns} (X-Trans)",
            "convert the files to HDR views elsewhere and give those",
        )
    # raw_pattern belongs to the whole sensor; the visible area may start at any of its positions. LibRaw's
    # black levels are by colour (R, G, B, second G), not by position.
    # (raw_colors_visible says the same, but is as large as the image.)
    top, left = raw.sizes.top_margin, raw.sizes.left_margin
    pattern = np.array([[raw.raw_color(top + i, left + j) for j in (0, 1)] for i in (0, 1)])
    black = np.array(raw.black_level_per_channel, np.float64)
    if sorted(pattern.ravel()) == [0, 1, 1, 2]:  # of some cameras, both greens have one index
        pattern.ravel()[np.flatnonzero(pattern.ravel() == 1)[1]] = 3
        black[3] = black[1]
    desc = raw.color_desc.decode()
    if desc[:3] != "RGB" or sorted(pattern.ravel()) != [0, 1, 2, 3]:
        raise FiptError(
            f"{path} must have a mosaic of red, green and blue; found {desc} {pattern.ravel().tolist()}",
            "convert the files to HDR views elsewhere and give those",
        )
    exact = _black_in_header(tags)
    if exact is not None and (np.abs(exact.ravel() - black[pattern.ravel()]) <= 1).all():
        black[pattern.ravel()] = exact.ravel()
    per_channel = raw.camera_white_level_per_channel
    white = np.array(per_channel if per_channel and min(per_channel) > 0 else [raw.white_level] * 4, np.float64)
    white = np.minimum(white, raw.white_level) if raw.white_level else white
    if (white - black <= 0).any():
        raise FiptError(
            f"{path} must have a white level above its black level; found {white.min():g} and {black.max():g}",
            "update rawpy (LibRaw), which may not know this camera well",
        )
    balance = np.array(raw.camera_whitebalance[:3], np.float64)
    usable = np.isfinite(balance).all() and balance.min() > 0
    mosaic = np.array(raw.raw_image_visible)  # a copy: LibRaw's own memory goes with it
    gains = balance / balance[1] if usable else None
    return RawFrame(mosaic, pattern, black, white, gains, _color_matrix(raw, tags), shot)


def _color_matrix(raw: Any, tags: dict[str, Any]) -> np.ndarray | None:
    """LibRaw's matrix of known cameras, else the one a DNG states for D65, else its first."""
    known = np.array(raw.rgb_xyz_matrix, np.float64)[:3]
    second = _number(tags, "Image Tag 0xC65B") == _D65  # CalibrationIlluminant2
    stated = _floats(tags.get("Image Tag 0xC622" if second else "Image Tag 0xC621"))  # ColorMatrix2, ColorMatrix1
    if not known.any() and stated.size == 9:
        known = stated.reshape(3, 3)
    return known if known.any() and np.isfinite(known).all() else None


def _black_in_header(tags: dict[str, Any]) -> np.ndarray | None:
    """(2, 2) black level by position as a DNG states it; LibRaw cuts off the fraction."""
    stated = _floats(tags.get("Image BlackLevel"))
    if stated.size not in (1, 4):
        return None
    return np.broadcast_to(stated.reshape(-1, 2 if stated.size == 4 else 1), (2, 2))


def _tags(file: Any) -> dict[str, Any]:
    import exifread

    logging.getLogger("exifread").setLevel(logging.ERROR)  # files without EXIF are no news
    try:
        return exifread.process_file(file, details=False)
    except Exception:  # noqa: BLE001 - ExifRead raises whatever its parsers raise
        return {}  # a damaged header: LibRaw or the missing exposure time will say so


def _shot(path: Path, tags: dict[str, Any], raw: Any) -> Shot:
    """Metadata from EXIF first, from LibRaw where EXIF is silent."""
    try:
        other = raw.other if raw is not None else None
    except (ValueError, OverflowError, OSError):  # a time that no calendar has
        other = None
    lens = raw.lens if raw is not None else None
    make, model = _words(tags, "Image Make"), _words(tags, "Image Model")
    camera = model if model and make and model.startswith(make) else " ".join(filter(None, [make, model]))
    orientation = int(_number(tags, "Image Orientation") or 1)
    time = _time(tags)
    if time is None and other is not None and other.timestamp is not None and other.timestamp.year > 1980:
        time = float(timegm(other.timestamp.timetuple()))
    return Shot(
        path=path,
        shutter=_usual("shutter", _number(tags, "EXIF ExposureTime") or _positive(other and other.shutter_speed)),
        aperture=_usual("aperture", _number(tags, "EXIF FNumber") or _positive(other and other.aperture)),
        iso=_usual("iso", _number(tags, "EXIF ISOSpeedRatings") or _positive(other and other.iso_speed)),
        focal_length=_number(tags, "EXIF FocalLength") or _positive(other and other.focal_length),
        focal_length_35=_number(tags, "EXIF FocalLengthIn35mmFilm"),
        camera=camera or None,
        lens=_words(tags, "EXIF LensModel") or (lens and lens.model) or None,
        serial=_words(tags, "EXIF BodySerialNumber"),
        time=time,
        orientation=orientation if orientation in range(1, 9) else 1,
    )


def _usual(key: str, value: float | None) -> float | None:
    """Return a value that cameras have; None: what a damaged file states."""
    low, high = USUAL[key]
    return value if value is not None and low <= value <= high else None


def _positive(value: Any) -> float | None:
    return float(value) if value and math.isfinite(value) and value > 0 else None


def _number(tags: dict[str, Any], name: str) -> float | None:
    found = _floats(tags.get(name))
    return _positive(float(found[0])) if found.size else None


def _floats(tag: Any) -> np.ndarray:
    """Numbers of a tag; none where it has none, or what is no number: text, a pair, a ratio to 0."""
    try:
        return np.array([float(value) for value in tag.values]) if tag is not None else np.zeros(0)
    except (TypeError, ValueError, ArithmeticError):
        return np.zeros(0)


def _words(tags: dict[str, Any], name: str) -> str | None:
    tag = tags.get(name)
    return str(tag.values).strip(" \0") or None if tag is not None else None


def _time(tags: dict[str, Any]) -> float | None:
    for kind in ("Original", "Digitized"):
        text = _words(tags, f"EXIF DateTime{kind}")
        try:
            seconds = timegm(datetime.strptime(text or "", "%Y:%m:%d %H:%M:%S").timetuple())
        except ValueError:
            continue
        digits = _words(tags, f"EXIF SubSecTime{kind}") or ""
        return seconds + (float(f"0.{digits}") if digits.isdigit() else 0.0)
    return None


def _no_exposure_time(path: Path) -> FiptError:
    return FiptError(f"{path} states no exposure time", "give it in captures.tsv (columns view, file, shutter)")


def _text(error: BaseException) -> str:
    reason = error.args[0] if error.args else error
    return reason.decode() if isinstance(reason, bytes) else str(reason)
