"""Settings of the capture: photographs to HDR views."""

from typing import Literal

from pydantic import Field

from fipt.settings import Count, Fraction, Length, Positive, Settings


class CaptureSettings(Settings):
    """Bracketed photographs to HDR views, and the calibration of their camera."""

    frames: Count = Field(default=0, le=32, description="exposures of a bracket; 0 = find out from times and exposures")
    incomplete: Literal["warn", "error"] = Field(
        default="warn", description="a bracket that lacks frames: use it, or stop"
    )
    times: Literal["snapped", "measured", "nominal"] = Field(
        default="snapped",
        description="exposure times: true third stops behind EXIF, measured from overlaps, or EXIF as it is",
    )
    merge: Literal["mosaic", "hat"] = Field(
        default="mosaic",
        description="merge mosaics and demosaic once, or demosaic each exposure and weigh by the hat (paper)",
    )
    saturation: float = Field(
        default=0.98, gt=0.5, le=1, description="share of the sensor's range above which it is full"
    )
    motion: Fraction = Field(
        default=0.03, description="disagreement of exposures beyond noise that counts as motion; 0 = do not look for it"
    )
    downscale: Positive = Field(default=1, le=16, description="average blocks of this many pixels a side")
    half: bool = Field(default=True, description="store radiance in 16 bits where that loses nothing against the noise")
    white_balance: Literal["reference", "camera", "none"] = Field(
        default="reference", description="gains from the white frames (else the camera's), the camera's, or none"
    )
    color: Literal["srgb", "camera"] = Field(
        default="srgb",
        description="linear sRGB by the camera's colour matrix where one is known, or the camera's own colours",
    )
    board_columns: int = Field(
        default=9, ge=3, le=64, description="inner corners along the calibration board's longer side"
    )
    board_rows: int = Field(default=6, ge=2, le=64, description="inner corners along its shorter side")
    board_square: Length = Field(default=0.025, description="side of a square of the board, metres")
    board_marker: Length = Field(default=0.018, description="side of a ChArUco marker, metres")
    board_dictionary: str = Field(default="DICT_5X5_100", description="ChArUco dictionary, as OpenCV names it")
    lensfun: bool = Field(
        default=True, description="look the lens up in lensfun's database where no frames calibrate it"
    )
    lensfun_distance: Length = Field(default=2.5, description="focus distance for lensfun, metres")
