"""A room in code or of a scene file, its views, and the camera that photographs it."""

from typing import Literal

from pydantic import Field

from fipt.settings import Angle, Count, Fraction, Length, Point, Positive, Rgb, Settings, Weight

Quad = tuple[float, float, float, float]


class SimulatedCamera(Settings):
    """A camera that photographs the room: exposure brackets as RAW files instead of finished HDR views."""

    scale: Positive = Field(3, le=8, description="sensor pixels along one pixel of a view")
    pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = Field("RGGB", description="Bayer pattern")
    bits: Literal[12, 14, 16] = Field(14, description="bits of a raw value")
    white_level: Positive | None = Field(None, le=65535, description="raw value at saturation; default: the largest")
    black_levels: Quad = Field(
        (512.25, 511.5, 513.0, 512.75), description="of the 2x2 cell, row by row, as the files state them"
    )
    dark_offset: Quad = Field((0.0, 0.0, 0.0, 0.0), description="what the true black levels have on top, raw values")
    distortion: tuple[float, float, float, float, float] = Field(
        (-0.10, 0.01, 0.0, 0.0, 0.0), description="k1, k2, p1, p2, k3 (Brown-Conrady, OpenCV's order)"
    )
    principal_offset: tuple[float, float] = Field(
        (0.0, 0.0), description="optical axis right of and below the view's, sensor pixels"
    )
    vignetting: tuple[float, float, float] = Field(
        (-0.35, -0.17, 0.05), description="of r^2, r^4, r^6; r = 1 at half the diagonal from the optical axis"
    )
    sensitivity: tuple[Length, Length, Length] = Field(
        (0.55, 1.0, 0.65), description="of red, green and blue; the white balance undoes it"
    )
    mixing: tuple[float, float, float, float, float, float, float, float, float] = Field(
        (1, 0, 0, 0, 1, 0, 0, 0, 1), description="camera RGB from linear sRGB before the sensitivity, row by row"
    )
    exposures: Positive = Field(5, le=15, description="frames of a bracket")
    step: Length = Field(2.0, le=4, description="between neighbouring exposures, EV; whole thirds")
    longest: Length = Field(0.25, le=32, description="longest exposure, seconds; snapped to third stops")
    shutter_error: Fraction = Field(0.0, le=0.2, description="standard deviation of true times off the third stops")
    shuffled: bool = Field(False, description="exposures of a bracket in random order instead of shortest first")
    white_radiance: Length = Field(60.0, description="radiance that saturates green in the shortest exposure")
    full_well: Length = Field(50_000.0, description="electrons at saturation")
    read_noise: Weight = Field(3.0, description="standard deviation, electrons")
    hot_pixels: Fraction = Field(0.0, le=0.1, description="share of pixels that glow with time")
    dead_pixels: Fraction = Field(0.0, le=0.1, description="share of pixels that see nothing")
    ghosts: tuple[str, ...] = Field((), description="views in which something stands in one exposure only")
    boards: tuple[Literal["checkerboard", "charuco"], ...] = Field(
        ("checkerboard",), description="kinds of calibration boards"
    )
    calibration_frames: Positive = Field(12, description="views of each board")
    board: tuple[Positive, Positive] = Field((9, 6), description="inner corners of the boards")
    square: Length = Field(0.025, description="side of their squares, metres; ChArUco markers have 0.72 of it")
    seed: Count = Field(0, description="seed of noise, hot pixels, ghosts and poses of the board")


class SceneFile(Settings):
    """A room read from a Mitsuba scene file."""

    environment: Literal["keep", "quads", "drop"] = Field(
        "keep",
        description="light from outside: `keep` it as background, close the openings with emitting `quads` that let as "
        "much in, or `drop` it",
    )
    allow_missing: bool = Field(
        False, description="go on where files are missing or plugins unknown: leave meshes out, make materials grey"
    )
    up: Literal["auto", "y", "z"] = Field(
        "auto", description="the file's up axis; `auto`: the one nearest to its camera's, else y. The room has y up"
    )
    scale: Length | None = Field(
        None, description="metres in a unit of the file; absent: 1, or what makes an odd interior 2.7 m high"
    )
    smoothest: Fraction = Field(0.15, ge=0.02, description="lowest roughness; smoother surfaces get it")
    max_texture: Positive = Field(1024, description="texels along the longer side; larger textures are averaged")


class SimulatedBoard(Settings):
    """A ChArUco board that stands in the room."""

    enabled: bool = Field(False, description="put it there; room.json has the places of its corners")
    place: Literal["floor", "wall"] = Field("floor", description="lies level, or stands before the nearest wall")
    position: Point = Field((3.85, 0.0, 2.05), description="of its centre, metres")
    turn: Angle = Field(15.0, description="clockwise as one looks at it, degrees")
    columns: int = Field(5, ge=2, le=64, description="inner corners along a row")
    rows: int = Field(4, ge=2, le=64, description="inner corners along a column")
    square: Length = Field(0.1, description="side of a square, metres")
    marker: Length = Field(0.075, description="side of a marker, metres")
    dictionary: str = Field("DICT_5X5_100", description="markers, as OpenCV names them")


class SynthesizeSettings(Settings):
    """A room in code or of a scene file, and its views."""

    train_views: Positive = Field(24, description="number of training views")
    val_views: Positive = Field(6, description="number of held-out views")
    cameras: Literal["scattered", "walk"] = Field(
        "scattered",
        description="cameras stand anywhere and look at what others do not show, or `walk` around the room in equal "
        "steps, so that poses can be estimated from what neighbours share",
    )
    width: Positive = Field(160, description="image width, pixels")
    height: Positive = Field(120, description="image height, pixels")
    fov: float = Field(70.0, gt=5, lt=150, description="horizontal field of view, degrees")
    spp: Positive = Field(256, description="paths per pixel of the rendered views")
    max_depth: Positive = Field(10, description="longest path, bounces")
    denoise: bool = Field(True, description="denoise the rendered views")
    opening: bool = Field(
        False, description="room in code: leave the window's pane out, so that light comes from the sky"
    )
    sky: Rgb = Field((8.0, 9.75, 12.5), description="radiance of the sky's horizon, where there is an opening")
    board: SimulatedBoard = Field(
        SimulatedBoard.model_validate({}), description="a ChArUco board that stands in the room"
    )
    seed: Count = Field(0, description="seed of room, cameras and noise")
    scene: SceneFile = Field(SceneFile.model_validate({}), description="how a scene file is read")
    raw: SimulatedCamera = Field(SimulatedCamera.model_validate({}), description="the camera of `simulate_raw`")
