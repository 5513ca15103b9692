"""Writes raw mosaics as DNG files (Adobe's DNG 1.4: TIFF with one uncompressed strip of 16-bit words).

The words hold 12, 14 or 16 bits: the white level says how many. LibRaw reads the samples back bit for bit. Files
without a mosaic (LinearRaw) can be written too: development must recognise and refuse them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import datetime
from fractions import Fraction
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import atomic

XYZ_FROM_SRGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""Linear sRGB to CIE XYZ under D65 (IEC 61966-2-1)."""

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
"""Bayer patterns, named by their 2x2 cell read row by row."""

SMALLEST = 22
"""Pixels a side that LibRaw asks of a picture."""

_FORMATS = {"byte": (1, "B"), "ascii": (2, "s"), "short": (3, "H"), "long": (4, "I"), "undefined": (7, "s")}
_RATIONALS = {"rational": (5, "I"), "srational": (10, "i")}
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
            f"LibRaw reads no picture with less than {SMALLEST} pixels a side; found {width}x{height}",
            "simulate a larger sensor",
        )
    samples = np.ascontiguousarray(mosaic, "<u2")
    exif = _directory(_exif_tags(header), start=8)
    start = 8 + len(exif)
    tags = _main_tags(samples.shape, header)
    # The length of a directory does not depend on the offsets in it.
    strip = start + len(_directory({**tags, 0x8769: ("long", [0]), 0x0111: ("long", [0])}, start))
    main = _directory({**tags, 0x8769: ("long", [8]), 0x0111: ("long", [strip])}, start)
    with atomic(path) as temporary, open(temporary, "wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, start) + exif + main)
        samples.tofile(file)


def _main_tags(shape: tuple[int, ...], header: Header) -> dict[int, tuple[str, object]]:
    """Tags of the image itself, in DNG 1.4's numbers, without its offsets."""
    (height, width), samples = shape[:2], (*shape, 1)[2]
    mosaic = {
        0x828D: ("short", [2, 2]),  # CFARepeatPatternDim
        0x828E: ("byte", ["RGB".index(letter) for letter in header.pattern]),
        0xC616: ("byte", [0, 1, 2]),  # CFAPlaneColor
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
        0xC612: ("byte", [1, 4, 0, 0]),  # DNGVersion
        0xC613: ("byte", [1, 1, 0, 0]),  # DNGBackwardVersion
        0xC614: ("ascii", f"{header.make} {header.model}"),  # UniqueCameraModel
        0xC61D: ("long", [header.white] * samples),  # WhiteLevel
        0xC621: ("srational", np.ravel(header.color_matrix)),
        0xC628: ("rational", header.neutral),  # AsShotNeutral
        0xC62F: ("ascii", header.serial),
        0xC65A: ("short", [_D65]),  # CalibrationIlluminant1
    }


def _exif_tags(header: Header) -> dict[int, tuple[str, object]]:
    stamp = header.time.strftime("%Y:%m:%d %H:%M:%S")
    exposure = {} if header.exposure is None else {0x829A: ("rational", [header.exposure])}
    return exposure | {
        0x829D: ("rational", [header.f_number]),
        0x8827: ("short", [header.iso]),
        0x9000: ("undefined", b"0231"),  # ExifVersion
        0x9003: ("ascii", stamp),  # DateTimeOriginal
        0x9004: ("ascii", stamp),
        0x920A: ("rational", [header.focal_length]),
        0x9291: ("ascii", f"{header.time.microsecond // 10000:02d}"),  # SubSecTimeOriginal
        0xA405: ("short", [round(header.focal_length_35)]),
        0xA431: ("ascii", header.serial),
        0xA434: ("ascii", header.lens),
    }


def _directory(tags: dict[int, tuple[str, object]], start: int) -> bytes:
    """Return a TIFF directory that begins at byte ``start`` of the file, with its long values behind it."""
    entries, values = b"", b""
    values_start = start + 2 + 12 * len(tags) + 4
    for tag, (kind, value) in sorted(tags.items()):
        code, count, data = _encoded(kind, value)
        if len(data) > 4:
            field = struct.pack("<I", values_start + len(values))
            values += data + b"\0" * (len(data) % 2)
        else:
            field = data.ljust(4, b"\0")
        entries += struct.pack("<HHI", tag, code, count) + field
    return struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0) + values


def _encoded(kind: str, value: object) -> tuple[int, int, bytes]:
    """TIFF type, count and bytes of a tag's value."""
    if kind in _RATIONALS:
        code, letter = _RATIONALS[kind]
        pairs = [Fraction(float(v) if isinstance(v, np.floating) else v).limit_denominator(10**6) for v in value]
        data = b"".join(struct.pack(f"<2{letter}", pair.numerator, pair.denominator) for pair in pairs)
        return code, len(pairs), data
    code, letter = _FORMATS[kind]
    if letter == "s":
        data = value if isinstance(value, bytes) else value.encode("ascii", "replace") + b"\0"
        return code, len(data), data
    return code, len(value), struct.pack(f"<{len(value)}{letter}", *value)
