"""What is known of a camera, and calibration.json, the file it lives in (described in docs/stages/capture.md)."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file, write_text
from fipt.formats.text import MALFORMED
from fipt.scene.lens import Lens
from fipt.strict_json import parse_json

FORMAT = 1
"""Version of calibration.json."""


@dataclass(frozen=True)
class Vignetting:
    """Falloff of light towards the corners: 1 + a1 r^2 + a2 r^4 + ..., r = 1 half a diagonal from the centre.

    Attributes
    ----------
    center
        (x, y) in pixels of the photograph as taken (before undistortion); pixel centres at halves.
    radius
        Half the image's diagonal in pixels.
    coefficients
        a1, a2, ...
    """

    center: tuple[float, float]
    radius: float
    coefficients: tuple[float, ...]

    def falloff(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Light at image points relative to the centre; ``x`` and ``y`` broadcast, float32 in, float32 out."""
        scale = np.float32(1 / self.radius)
        r2 = ((x - np.float32(self.center[0])) * scale) ** 2 + ((y - np.float32(self.center[1])) * scale) ** 2
        value = np.zeros_like(r2)
        for coefficient in reversed(self.coefficients):
            value += np.float32(coefficient)
            value *= r2
        value += 1
        return value


@dataclass(frozen=True)
class Noise:
    """Variance of a raw value z (black subtracted, in raw units): gain z + read^2.

    Attributes
    ----------
    gain
        Raw units per photo-electron.
    read
        Standard deviation in the dark, raw units.
    iso
        ISO speed at which this holds.
    """

    gain: float
    read: float
    iso: float


@dataclass(frozen=True)
class Calibration:
    """What develops the photographs of one camera. Absent parts are None or empty, and said in ``absent``.

    Attributes
    ----------
    kind
        ``raw``, ``ldr`` or ``merged``: the photographs that it belongs to.
    camera
        Name as the camera writes it.
    width, height
        Size of the photographs, pixels.
    black
        Black level by colour index (red, green, blue, second green) in raw units; None: as each file states.
    bad_pixels
        (row, column) of pixels to replace by their neighbours.
    noise
        Of the sensor; None: estimated from each bracket.
    vignetting
        None: none is corrected.
    lens
        Intrinsics and distortion; None: unknown, nothing is undistorted.
    white_balance
        Gains of red, green, blue.
    color
        (3, 3) linear sRGB from white-balanced camera RGB; white stays white. None: unknown, colours stay the camera's.
    response
        (256, 3) log exposure of each 8-bit value, for JPEG and PNG; None for RAW.
    sources
        Part -> where it comes from.
    absent
        What was not found, and what is done instead; sentences.
    figures
        Reprojection error, board views, vignetting curve: for the report.
    """

    kind: str
    camera: str | None
    width: int
    height: int
    black: tuple[float, float, float, float] | None = None
    bad_pixels: tuple[tuple[int, int], ...] = ()
    noise: Noise | None = None
    vignetting: Vignetting | None = None
    lens: Lens | None = None
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color: tuple[tuple[float, float, float], ...] | None = None
    response: tuple[tuple[float, float, float], ...] | None = None
    sources: dict[str, str] = field(default_factory=dict)
    absent: tuple[str, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)

    def check_size(self, shape: tuple[int, int], path: Path) -> None:
        """Raise FiptError unless photographs of (height, width) ``shape`` fit this calibration."""
        if shape != (self.height, self.width):
            raise FiptError(
                f"{path} must be {self.width}x{self.height} as the calibration; found {shape[1]}x{shape[0]}",
                "calibrate with frames of the same camera and image size",
            )


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write calibration.json, whole or not at all."""
    write_text(path, json.dumps({"format": FORMAT, **asdict(calibration)}, indent=1) + "\n")


def read_calibration(path: str | Path) -> Calibration:
    """Read calibration.json.

    Raises
    ------
    FiptError
        If it is missing, not JSON, of another format version or lacks a key.
    """
    existing_file(path, "calibration.json")
    try:
        content = parse_json(Path(path).read_text(encoding="utf-8"))
        version = content.pop("format")
    except MALFORMED as error:
        raise FiptError(f"{path} is not a calibration ({error!r})", "run fipt calibrate again") from error
    if version != FORMAT:
        raise FiptError(f"{path} must have format {FORMAT}; found {version}", "run fipt calibrate again")
    try:
        noise, vignetting, lens = (content.pop(key) for key in ("noise", "vignetting", "lens"))
        calibration = Calibration(
            **{key: _tuples(value) if key not in ("sources", "figures") else value for key, value in content.items()},
            noise=noise and Noise(**noise),
            vignetting=vignetting and Vignetting(**{key: _tuples(value) for key, value in vignetting.items()}),
            lens=lens and Lens(**{key: _tuples(value) for key, value in lens.items()}),
        )
        _check_values(calibration)
    except MALFORMED as error:
        raise FiptError(f"{path} is not a calibration ({error!r})", "run fipt calibrate again") from error
    return calibration


def _check_values(calibration: Calibration) -> None:
    """Raise ValueError where a calibration has numbers that no camera has."""
    lens = calibration.lens
    numbers: dict[str, Any] = {name: getattr(calibration, name) or () for name in ("white_balance", "black", "color")}
    numbers["response"] = calibration.response or ()
    numbers["lens"] = () if lens is None else (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    for name, values in numbers.items():
        if not np.isfinite(np.asarray(values, np.float64)).all():
            raise ValueError(f"{name} must be finite numbers")
    if calibration.kind == "ldr" and np.shape(numbers["response"]) != (256, 3):
        raise ValueError("the response of JPEG and PNG must have 256 rows of three numbers")
    sizes = (calibration.width, calibration.height, *calibration.white_balance, *numbers["lens"][:2])
    if min(sizes) <= 0:
        raise ValueError("size, white balance and focal lengths must be above 0")


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
