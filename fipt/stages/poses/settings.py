"""Settings of the poses."""

from typing import Annotated, Literal

from pydantic import Field

from fipt.settings import Count, Fraction, Length, Positive, Settings


class SceneBoard(Settings):
    """A board of known size that stands in the photographed room."""

    kind: Literal["charuco", "apriltag"] = Field(default="charuco", description="a ChArUco board, or single AprilTags")
    columns: int = Field(default=5, ge=2, le=64, description="inner corners along a row of a ChArUco board")
    rows: int = Field(default=4, ge=2, le=64, description="inner corners along its columns")
    square: Length = Field(default=0.1, description="side of a square of a ChArUco board, metres")
    marker: Length = Field(
        default=0.075, description="side of a marker, or of every AprilTag (its black square), metres"
    )
    dictionary: str = Field(
        default="DICT_5X5_100", description="markers, as OpenCV names them: DICT_APRILTAG_36h11 for tags"
    )
    place: Literal["floor", "wall", "anywhere"] = Field(
        default="floor", description="lies on the floor, hangs upright on a wall, or tells nothing about up"
    )


class KnownDistance(Settings):
    """A measured distance between two named points."""

    between: tuple[str, str] = Field(description="names of two entries of `points`")
    metres: Length = Field(description="measured distance, metres")


Pixel = Annotated[tuple[float, float], Field(description="column and row, the top left pixel's centre at 0.5, 0.5")]


class Align(Settings):
    """Metres, up, walls and origin of estimated poses."""

    reference: str | None = Field(
        default=None,
        description="transforms.json with known positions of three or more of the views (survey, an earlier run): "
        "poses are brought to its axes and scale, and the keys below are not used; {data_root} is replaced",
    )
    board: SceneBoard | None = Field(default=None, description="a board of known size that stands in the room")
    points: dict[str, dict[str, Pixel]] = Field(
        default={}, description="named points: view -> [column, row] of the undistorted image, in two or more views"
    )
    distances: tuple[KnownDistance, ...] = Field(default=(), description="measured distances between named points")
    tripod_height: Length | None = Field(default=None, description="of the lens above the floor in all views, metres")
    scale: Literal["auto", "board", "distances", "tripod"] = Field(
        default="auto", description="what metres come from; `auto`: the first of these that is given"
    )
    up: Literal["auto", "board", "floor", "cameras"] = Field(
        default="auto", description="what up comes from; `auto`: the first of these that is found"
    )
    walls: bool = Field(
        default=True, description="turn the room about the up axis so that its walls face along x and z"
    )
    seed: Count = Field(default=0, description="seed of the search for the floor")


class PosesSettings(Settings):
    """Cameras from images (COLMAP), where a scene has `poses: colmap`."""

    intrinsics: Literal["fixed", "refined"] = Field(
        default="fixed", description="focal lengths: as given, or estimated too"
    )
    max_size: Positive = Field(
        default=2400, description="images are scaled down to this many pixels for finding features"
    )
    max_features: Positive = Field(default=8192, description="features of an image, the largest ones")
    peak: float = Field(default=0.004, gt=0, le=0.1, description="contrast that a feature must have; lower finds more")
    exhaustive_below: Positive = Field(
        default=300, description="fewer views than this: every pair of images is matched"
    )
    overlap: Positive = Field(
        default=12, description="otherwise: neighbours that an image is matched with, and each 2^n-th"
    )
    match_ratio: float = Field(
        default=0.8, gt=0, le=1, description="of the distances to best and second best match, at most"
    )
    min_matches: tuple[Positive, ...] = Field(
        default=(15, 30, 60, 100),
        min_length=1,
        description="matches that link two views; each is tried, and the results compared",
    )
    max_shift: float = Field(
        default=0.01,
        gt=0,
        le=1,
        description="incremental and global mapping agree on a camera's place, share of the extent",
    )
    max_turn: float = Field(default=1.0, gt=0, le=180, description="and on its direction, degrees")
    min_points: Positive = Field(default=30, description="points that a camera must see")
    min_shared: Positive = Field(default=20, description="points that two views must share to hold each other")
    max_error: Length = Field(default=2.0, description="mean reprojection error that a camera may have, pixels")
    min_share: Fraction = Field(
        default=0.7, description="share of the views that must get a pose; else the stage stops"
    )
    threads: Count = Field(default=0, description="CPU threads of features and matching, 0 = all")
    seed: Count = Field(default=0, description="seed of the random numbers")
    align: Align = Field(default=Align(), description="metres, up and axes")
