"""Writes raw mosaics as DNG files (Adobe's DNG 1.4: TIFF with one uncompressed strip of 16-bit words).

Pillow encodes the directories of tags (docs/adr/0026-library-code.md says why not tifffile). The words hold 12, 14 or
16 bits: the white level says how many. LibRaw reads the samples back bit for bit. Files
without a mosaic (LinearRaw) can be written too: development must recognise and refuse them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import atomic

if TYPE_CHECKING:
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
"""Bayer patterns, named by their 2x2 cell read row by row."""

SMALLEST = 22
"""Pixels a side that LibRaw asks of an image."""

_TYPES = {"byte": 1, "ascii": 2, "short": 3, "long": 4, "rational": 5, "srational": 10}
"""Numbers of TIFF's types."""
_D65 = 21


@dataclass(frozen=True)
class Header:
    """What a DNG says about its mosaic and about how it was taken.

    Attributes
    ----------
    pattern
        One of `PATTERNS`.
    black
        Black level at each position of the 2x2 cell, row by row, in raw values; may be fractional.
    white
        Raw value at which the sensor saturates.
    color_matrix
        (3, 3) camera RGB from CIE XYZ under D65.
    neutral
        Camera RGB of a white surface, its largest component 1.
    exposure
        Shutter time that the camera prints, seconds; None leaves it out, as some damaged files do.
    f_number, iso, focal_length, focal_length_35
        Aperture, sensitivity, focal length and its equivalent on 36 x 24 mm, both in millimetres.
    time
        When the shutter opened.
    make, model, serial, lens
        Names of camera and lens.
    orientation
        TIFF orientation; 1 = as it is, 6 and 8 = held upright.
    """

    pattern: str
    black: tuple[float, float, float, float]
    white: int
    color_matrix: np.ndarray
    neutral: tuple[float, float, float]
    exposure: Fraction | None
    f_number: float
    iso: int
    focal_length: float
    focal_length_35: float
    time: datetime
    make: str = "fipt"
    model: str = "Simulated camera"
    serial: str = "0001"
    lens: str = "Simulated lens"
    orientation: int = 1


def write_dng(path: str | Path, mosaic: np.ndarray, header: Header) -> None:
    """Write a mosaic as a DNG file.

    Parameters
    ----------
    path
        File to write; it appears only when it is complete.
    mosaic
        (height, width) uint16 raw values, or (height, width, 3) linear RGB.
    header
        What the file says about them.
    """
    if header.pattern not in PATTERNS:
        raise FiptError(f"the Bayer pattern must be one of {', '.join(PATTERNS)}; found {header.pattern}")
    if mosaic.dtype != np.uint16 or mosaic.ndim < 2 or mosaic.shape[2:] not in ((), (3,)):
        raise FiptError(f"a mosaic must be (height, width) uint16; found {mosaic.shape} {mosaic.dtype}")
    height, width = mosaic.shape[:2]
    if min(height, width) < SMALLEST:
        raise FiptError(
            f"LibRaw reads no image with less than {SMALLEST} pixels a side; found {width}x{height}",
            "simulate a larger sensor",
        )
    samples = np.ascontiguousarray(mosaic, "<u2")
    directory = _directory(_main_tags(samples.shape, header), _exif_tags(header))
    with atomic(path) as temporary, open(temporary, "wb") as file:
        directory.save(file)
        samples.tofile(file)


def _main_tags(shape: tuple[int, ...], header: Header) -> dict[int, tuple[str, Any]]:
    """Tags of the image itself, in DNG 1.4's numbers, without its offsets: tag -> (type, value)."""
    (height, width), samples = shape[:2], (*shape, 1)[2]
    mosaic = {
        0x828D: ("short", [2, 2]),  # CFARepeatPatternDim
        0x828E: ("byte", bytes("RGB".index(letter) for letter in header.pattern)),
        0xC616: ("byte", bytes([0, 1, 2])),  # CFAPlaneColor
        0xC617: ("short", [1]),  # CFALayout: rectangular
        0xC619: ("short", [2, 2]),  # BlackLevelRepeatDim
        0xC61A: ("rational", header.black),
    }
    stamp = header.time.strftime("%Y:%m:%d %H:%M:%S")
    return (mosaic if samples == 1 else {}) | {
        0x00FE: ("long", [0]),  # NewSubfileType: the full image
        0x0100: ("long", [width]),
        0x0101: ("long", [height]),
        0x0102: ("short", [16] * samples),  # BitsPerSample
        0x0103: ("short", [1]),  # Compression: none
        0x0106: ("short", [32803 if samples == 1 else 34892]),  # PhotometricInterpretation: mosaic or LinearRaw
        0x010F: ("ascii", header.make),
        0x0110: ("ascii", header.model),
        0x0112: ("short", [header.orientation]),
        0x0115: ("short", [samples]),  # SamplesPerPixel
        0x0116: ("long", [height]),  # RowsPerStrip
        0x0117: ("long", [height * width * samples * 2]),  # StripByteCounts
        0x011C: ("short", [1]),  # PlanarConfiguration
        0x0131: ("ascii", "fipt"),  # Software
        0x0132: ("ascii", stamp),
        0xC612: ("byte", bytes([1, 4, 0, 0])),  # DNGVersion
        0xC613: ("byte", bytes([1, 1, 0, 0])),  # DNGBackwardVersion
        0xC614: ("ascii", f"{header.make} {header.model}"),  # UniqueCameraModel
        0xC61D: ("long", [header.white] * samples),  # WhiteLevel
        0xC621: ("srational", np.ravel(header.color_matrix)),
        0xC628: ("rational", header.neutral),  # AsShotNeutral
        0xC62F: ("ascii", header.serial),
        0xC65A: ("short", [_D65]),  # CalibrationIlluminant1
    }


def _exif_tags(header: Header) -> dict[int, Any]:
    """Tags of the shot; Pillow knows their types."""
    stamp = header.time.strftime("%Y:%m:%d %H:%M:%S")
    exposure = {} if header.exposure is None else {0x829A: _rationals([header.exposure])}
    return exposure | {
        0x829D: _rationals([header.f_number]),
        0x8827: header.iso,
        0x9000: b"0231",  # ExifVersion
        0x9003: stamp,  # DateTimeOriginal
        0x9004: stamp,
        0x920A: _rationals([header.focal_length]),
        0x9291: f"{header.time.microsecond // 10000:02d}",  # SubSecTimeOriginal
        0xA405: round(header.focal_length_35),
        0xA431: header.serial,
        0xA434: header.lens,
    }


def _directory(tags: dict[int, tuple[str, Any]], exif: dict[int, Any]) -> ImageFileDirectory_v2:
    """A TIFF directory with an EXIF directory inside; the image's strip follows right behind it."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    directory = ImageFileDirectory_v2()
    for tag, (kind, value) in tags.items():
        directory.tagtype[tag] = _TYPES[kind]
        directory[tag] = _rationals(value) if kind.endswith("rational") else value
    directory[0x8769] = exif
    directory.tagtype[0x0111] = _TYPES["long"]
    directory[0x0111] = 0  # StripOffsets: Pillow counts from the directory's end
    return directory


def _rationals(values: Iterable[Any]) -> tuple[Any, ...]:
    """Values as Pillow writes them, with denominators of up to a million."""
    from PIL.TiffImagePlugin import IFDRational

    exact = (Fraction(float(v) if isinstance(v, np.floating) else v).limit_denominator(10**6) for v in values)
    return tuple(IFDRational(v) for v in exact)
