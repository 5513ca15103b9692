"""A room in code or of a scene file, its views, and the camera that photographs it."""

from typing import Literal

from pydantic import Field

from fipt.settings import Angle, Count, Fraction, Length, Point, Positive, Rgb, Settings, Weight

RoomName = Literal["living_room", "bathroom", "office", "kitchen", "blinds", "skylight"]
"""Rooms in code: files of `fipt.synthetic.rooms`."""

Quad = tuple[float, float, float, float]


class SimulatedCamera(Settings):
    """A camera that photographs the room: exposure brackets as RAW files instead of finished HDR views."""

    scale: Positive = Field(default=3, le=8, description="sensor pixels along one pixel of a view")
    pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = Field(default="RGGB", description="Bayer pattern")
    bits: Literal[12, 14, 16] = Field(default=14, description="bits of a raw value")
    white_level: Positive | None = Field(
        default=None, le=65535, description="raw value at saturation; default: the largest"
    )
    black_levels: Quad = Field(
        default=(512.25, 511.5, 513.0, 512.75), description="of the 2x2 cell, row by row, as the files state them"
    )
    dark_offset: Quad = Field(
        default=(0.0, 0.0, 0.0, 0.0), description="what the true black levels have on top, raw values"
    )
    distortion: tuple[float, float, float, float, float] = Field(
        default=(-0.10, 0.01, 0.0, 0.0, 0.0), description="k1, k2, p1, p2, k3 (Brown-Conrady, OpenCV's order)"
    )
    principal_offset: tuple[float, float] = Field(
        default=(0.0, 0.0), description="optical axis right of and below the view's, sensor pixels"
    )
    vignetting: tuple[float, float, float] = Field(
        default=(-0.35, -0.17, 0.05), description="of r^2, r^4, r^6; r = 1 at half the diagonal from the optical axis"
    )
    sensitivity: tuple[Length, Length, Length] = Field(
        default=(0.55, 1.0, 0.65), description="of red, green and blue; the white balance undoes it"
    )
    mixing: tuple[float, float, float, float, float, float, float, float, float] = Field(
        default=(1, 0, 0, 0, 1, 0, 0, 0, 1),
        description="camera RGB from linear sRGB before the sensitivity, row by row",
    )
    exposures: Positive = Field(default=5, le=15, description="frames of a bracket")
    step: Length = Field(default=2.0, le=4, description="between neighbouring exposures, EV; whole thirds")
    longest: Length = Field(default=0.25, le=32, description="longest exposure, seconds; snapped to third stops")
    shutter_error: Fraction = Field(
        default=0.0, le=0.2, description="standard deviation of true times off the third stops"
    )
    shuffled: bool = Field(
        default=False, description="exposures of a bracket in random order instead of shortest first"
    )
    white_radiance: Length = Field(default=60.0, description="radiance that saturates green in the shortest exposure")
    full_well: Length = Field(default=50_000.0, description="electrons at saturation")
    read_noise: Weight = Field(default=3.0, description="standard deviation, electrons")
    hot_pixels: Fraction = Field(default=0.0, le=0.1, description="share of pixels that glow with time")
    dead_pixels: Fraction = Field(default=0.0, le=0.1, description="share of pixels that see nothing")
    ghosts: tuple[str, ...] = Field(default=(), description="views in which something stands in one exposure only")
    boards: tuple[Literal["checkerboard", "charuco"], ...] = Field(
        default=("checkerboard",), description="kinds of calibration boards"
    )
    calibration_frames: Positive = Field(default=12, description="views of each board")
    board: tuple[Positive, Positive] = Field(default=(9, 6), description="inner corners of the boards")
    square: Length = Field(default=0.025, description="side of their squares, metres; ChArUco markers have 0.72 of it")
    seed: Count = Field(default=0, description="seed of noise, hot pixels, ghosts and poses of the board")


class SceneFile(Settings):
    """A room read from a Mitsuba scene file."""

    environment: Literal["keep", "quads", "drop"] = Field(
        default="keep",
        description="light from outside: `keep` it as background, close the openings with emitting `quads` that let as "
        "much in, or `drop` it",
    )
    allow_missing: bool = Field(
        default=False,
        description="go on where files are missing or plugins unknown: leave meshes out, make materials grey",
    )
    up: Literal["auto", "y", "z"] = Field(
        default="auto",
        description="the file's up axis; `auto`: the one nearest to its camera's, else y. The room has y up",
    )
    scale: Length | None = Field(
        default=None, description="metres in a unit of the file; absent: 1, or what makes an odd interior 2.7 m high"
    )
    smoothest: Fraction = Field(default=0.15, ge=0.02, description="lowest roughness; smoother surfaces get it")
    max_texture: Positive = Field(
        default=1024, description="texels along the longer side; larger textures are averaged"
    )


class SimulatedBoard(Settings):
    """A ChArUco board that stands in the room."""

    enabled: bool = Field(default=False, description="put it there; room.json has the places of its corners")
    place: Literal["floor", "wall"] = Field(
        default="floor", description="lies level, or stands before the nearest wall"
    )
    position: Point = Field(default=(3.85, 0.0, 2.05), description="of its centre, metres")
    turn: Angle = Field(default=15.0, description="clockwise as one looks at it, degrees")
    columns: int = Field(default=5, ge=2, le=64, description="inner corners along a row")
    rows: int = Field(default=4, ge=2, le=64, description="inner corners along a column")
    square: Length = Field(default=0.1, description="side of a square, metres")
    marker: Length = Field(default=0.075, description="side of a marker, metres")
    dictionary: str = Field(default="DICT_5X5_100", description="markers, as OpenCV names them")


class SynthesizeSettings(Settings):
    """A room in code or of a scene file, and its views."""

    room: RoomName = Field(default="living_room", description="which room in code")
    train_views: Positive = Field(default=24, description="number of training views")
    val_views: Positive = Field(default=6, description="number of held-out views")
    cameras: Literal["scattered", "walk"] = Field(
        default="scattered",
        description="cameras stand anywhere and look at what others do not show, or `walk` around the room in equal "
        "steps, so that poses can be estimated from what neighbours share",
    )
    width: Positive = Field(default=160, description="image width, pixels")
    height: Positive = Field(default=120, description="image height, pixels")
    fov: float = Field(default=70.0, gt=5, lt=150, description="horizontal field of view, degrees")
    spp: Positive = Field(default=256, description="paths per pixel of the rendered views, best a square number")
    max_depth: Positive = Field(default=32, description="longest path, bounces")
    denoise: bool = Field(default=True, description="denoise the rendered views")
    opening: bool = Field(
        default=False, description="room in code: leave the panes of its windows out, so that light comes from the sky"
    )
    sky: Rgb = Field(default=(8.0, 9.75, 12.5), description="radiance of the sky's horizon, where there is an opening")
    board: SimulatedBoard = Field(default=SimulatedBoard(), description="a ChArUco board that stands in the room")
    seed: Count = Field(default=0, description="seed of room, cameras and noise")
    scene: SceneFile = Field(default=SceneFile(), description="how a scene file is read")
    raw: SimulatedCamera = Field(default=SimulatedCamera(), description="the camera of `simulate_raw`")
