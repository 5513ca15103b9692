"""Settings of every stage: frozen models whose defaults are the preset ``default``; unknown keys are errors."""

import json
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from operator import sub
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from fipt.errors import FiptError

Positive = Annotated[int, Field(ge=1)]
Count = Annotated[int, Field(ge=0)]
Weight = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Length = Annotated[float, Field(gt=0)]
Rgb = Annotated[tuple[Weight, Weight, Weight], Field(description="linear RGB")]
Angle = Annotated[float, Field(ge=-360, le=360)]
Point = Annotated[tuple[float, float, float], Field(description="world position, metres")]


class Settings(BaseModel):
    """Base of all settings: frozen, unknown keys refused, NaN refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


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


class Synthesize(Settings):
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
    board: SimulatedBoard = Field(SimulatedBoard(), description="a ChArUco board that stands in the room")
    seed: Count = Field(0, description="seed of room, cameras and noise")
    scene: SceneFile = Field(SceneFile(), description="how a scene file is read")
    raw: SimulatedCamera = Field(SimulatedCamera(), description="the camera of `simulate_raw`")


class Capture(Settings):
    """Bracketed photographs to HDR views, and the calibration of their camera."""

    frames: Count = Field(0, le=32, description="exposures of a bracket; 0 = find out from times and exposures")
    incomplete: Literal["warn", "error"] = Field("warn", description="a bracket that lacks frames: use it, or stop")
    times: Literal["snapped", "measured", "nominal"] = Field(
        "snapped", description="exposure times: true third stops behind EXIF, measured from overlaps, or EXIF as it is"
    )
    merge: Literal["mosaic", "hat"] = Field(
        "mosaic", description="merge mosaics and demosaic once, or demosaic each exposure and weigh by the hat (paper)"
    )
    saturation: float = Field(0.98, gt=0.5, le=1, description="share of the sensor's range above which it is full")
    motion: Fraction = Field(
        0.03, description="disagreement of exposures beyond noise that counts as motion; 0 = do not look for it"
    )
    downscale: Positive = Field(1, le=16, description="average blocks of this many pixels a side")
    half: bool = Field(True, description="store radiance in 16 bits where that loses nothing against the noise")
    white_balance: Literal["reference", "camera", "none"] = Field(
        "reference", description="gains from the white frames (else the camera's), the camera's, or none"
    )
    color: Literal["srgb", "camera"] = Field(
        "srgb", description="linear sRGB by the camera's colour matrix where one is known, or the camera's own colours"
    )
    board_columns: int = Field(9, ge=3, le=64, description="inner corners along the calibration board's longer side")
    board_rows: int = Field(6, ge=2, le=64, description="inner corners along its shorter side")
    board_square: Length = Field(0.025, description="side of a square of the board, metres")
    board_marker: Length = Field(0.018, description="side of a ChArUco marker, metres")
    board_dictionary: str = Field("DICT_5X5_100", description="ChArUco dictionary, as OpenCV names it")
    lensfun: bool = Field(True, description="look the lens up in lensfun's database where no frames calibrate it")
    lensfun_distance: Length = Field(2.5, description="focus distance for lensfun, metres")


class SceneBoard(Settings):
    """A board of known size that stands in the photographed room."""

    kind: Literal["charuco", "apriltag"] = Field("charuco", description="a ChArUco board, or single AprilTags")
    columns: int = Field(5, ge=2, le=64, description="inner corners along a row of a ChArUco board")
    rows: int = Field(4, ge=2, le=64, description="inner corners along its columns")
    square: Length = Field(0.1, description="side of a square of a ChArUco board, metres")
    marker: Length = Field(0.075, description="side of a marker, or of every AprilTag (its black square), metres")
    dictionary: str = Field("DICT_5X5_100", description="markers, as OpenCV names them: DICT_APRILTAG_36h11 for tags")
    place: Literal["floor", "wall", "anywhere"] = Field(
        "floor", description="lies on the floor, hangs upright on a wall, or tells nothing about up"
    )


class KnownDistance(Settings):
    """A measured distance between two named points."""

    between: tuple[str, str] = Field(description="names of two entries of `points`")
    metres: Length = Field(description="measured distance, metres")


Pixel = Annotated[tuple[float, float], Field(description="column and row, the top left pixel's centre at 0.5, 0.5")]


class Align(Settings):
    """Metres, up, walls and origin of estimated poses."""

    reference: str | None = Field(
        None,
        description="transforms.json with known positions of three or more of the views (survey, an earlier run): "
        "poses are brought to its axes and scale, and the keys below are not used; {data_root} is replaced",
    )
    board: SceneBoard | None = Field(None, description="a board of known size that stands in the room")
    points: dict[str, dict[str, Pixel]] = Field(
        {}, description="named points: view -> [column, row] of the undistorted picture, in two or more views"
    )
    distances: tuple[KnownDistance, ...] = Field((), description="measured distances between named points")
    tripod_height: Length | None = Field(None, description="of the lens above the floor in all views, metres")
    scale: Literal["auto", "board", "distances", "tripod"] = Field(
        "auto", description="what metres come from; `auto`: the first of these that is given"
    )
    up: Literal["auto", "board", "floor", "cameras"] = Field(
        "auto", description="what up comes from; `auto`: the first of these that is found"
    )
    walls: bool = Field(True, description="turn the room about the up axis so that its walls face along x and z")
    seed: Count = Field(0, description="seed of the search for the floor")


class Poses(Settings):
    """Cameras from pictures (COLMAP), where a scene has `poses: colmap`."""

    intrinsics: Literal["fixed", "refined"] = Field("fixed", description="focal lengths: as given, or estimated too")
    max_size: Positive = Field(2400, description="pictures are scaled down to this many pixels for finding features")
    max_features: Positive = Field(8192, description="features of a picture, the largest ones")
    peak: float = Field(0.004, gt=0, le=0.1, description="contrast that a feature must have; lower finds more")
    exhaustive_below: Positive = Field(300, description="fewer views than this: every pair of pictures is matched")
    overlap: Positive = Field(12, description="otherwise: neighbours that a picture is matched with, and each 2^n-th")
    match_ratio: float = Field(0.8, gt=0, le=1, description="of the distances to best and second best match, at most")
    min_matches: tuple[Positive, ...] = Field(
        (15, 30, 60, 100),
        min_length=1,
        description="matches that link two views; each is tried, and the results compared",
    )
    max_shift: float = Field(
        0.01, gt=0, le=1, description="incremental and global mapping agree on a camera's place, share of the extent"
    )
    max_turn: float = Field(1.0, gt=0, le=180, description="and on its direction, degrees")
    min_points: Positive = Field(30, description="points that a camera must see")
    min_shared: Positive = Field(20, description="points that two views must share to hold each other")
    max_error: Length = Field(2.0, description="mean reprojection error that a camera may have, pixels")
    min_share: Fraction = Field(0.7, description="share of the views that must get a pose; else the stage stops")
    threads: Count = Field(0, description="CPU threads of features and matching, 0 = all")
    seed: Count = Field(0, description="seed of the random numbers")
    align: Align = Field(Align(), description="metres, up and axes")


class Import(Settings):
    """Other people's layouts into a dataset."""

    val_every: Positive = Field(8, description="every n-th view is held out where the source has no split")
    overlay: bool = Field(True, description="write a picture of mesh edges over one photo")
    exposure: Length | None = Field(
        None, description="factor on a capture's radiance; absent: what brings its median luminance to 0.2"
    )


class CheckPoses(Settings):
    """Second check of the cameras, through the mesh: every view must show what the others show."""

    enabled: bool | None = Field(
        None, description="check before the fit; absent: for true photographs and estimated poses"
    )
    width: Positive = Field(192, description="pictures are reduced to this many columns at most")
    partners: Positive = Field(10, description="other views that each view is compared with, those that share most")
    least_score: Fraction = Field(
        0.55,
        description="a view is rejected whose correlation with the others is below this share of the median view's",
    )
    least_overlap: Fraction = Field(0.05, description="share of a view that others must show to judge it")
    keep: Fraction = Field(0.7, description="with fewer views than this share left, stop: mesh and views do not match")


class Hits(Settings):
    """First hits of camera rays."""

    grid: Positive = Field(
        4,
        le=16,
        description="a pixel is sampled by the square of this many rays; 1 = its centre only",
    )
    max_hits: Positive = Field(4, le=16, description="distinct surface pieces kept for each pixel")


class Segment(Settings):
    """Segment ids of the training views: where they come from."""

    mode: Literal["auto", "mask2former", "given", "geometry", "none"] = Field(
        "auto",
        description="`mask2former`: a network per view; `given`: from `path`; `geometry`: grown on the mesh; these "
        "are fused on the mesh; `none`: fit without; `auto`: the dataset's own ids, `geometry` where it has none",
    )
    model: str = Field(
        "facebook/mask2former-swin-large-coco-panoptic",
        description="checkpoint of Mask2Former in the local cache, or a folder; {data_root} is replaced",
    )
    task: Literal["panoptic", "semantic"] = Field("panoptic", description="objects of a class apart, or as one")
    exposure: Length = Field(1.0, description="factor on the radiance that the network sees, before its gamma of 1/2.2")
    score: Fraction = Field(0.8, description="least probability of the class of a panoptic segment")
    overlap: Fraction = Field(0.8, description="least share of a panoptic segment that others leave it")
    batch: Positive = Field(1, le=64, description="views that the network sees at once")
    half: bool = Field(True, description="half precision where there is CUDA")
    threads: Count = Field(0, description="CPU threads of the network, 0 = all")
    path: str | None = Field(
        None,
        description="of mode `given`: a folder of ids by view (PNG, EXR), or labels of the mesh's triangles (PLY, NPZ)"
        "; {data_root} is replaced",
    )
    property: str = Field("segment", description="property of a PLY's faces, or array of an NPZ, that holds the labels")
    other_size: Literal["nearest", "error"] = Field(
        "nearest", description="given ids of another size than their view: take the nearest with a warning, or stop"
    )


class Fuse(Settings):
    """Segment ids of single views to ids on the mesh."""

    vote: Literal["area", "count"] = Field(
        "area", description="a pixel's vote: its cosine of the viewing angle, or one (`count`, as the paper)"
    )
    associate: Literal["overlap", "ids", "classes"] = Field(
        "overlap",
        description="segments of different views are one by their overlap on the mesh, by the same id, or by class",
    )
    overlap: float = Field(
        0.25, gt=0, lt=1, description="of the surface that two views see: intersection over union that speaks for one"
    )
    speckles: bool = Field(True, description="pixels that agree with fewer than two of eight around do not vote")
    sharpen: Count = Field(3, le=20, description="passes that give votes near edges to the cells they belong to")
    split: bool = Field(True, description="cut large triangles for the votes, so that segments may end inside them")
    cell: Weight = Field(0.0, description="longest side of the pieces, metres; 0 = two pixel widths")
    most_cells: Positive = Field(1_000_000, le=20_000_000, description="pieces are larger where there would be more")
    pieces: Literal["auto", "all", "none"] = Field(
        "auto",
        description="segments that do not hang together are one part a piece: those of classes of which no view shows "
        "two, all, or none",
    )
    gap: Length = Field(0.1, description="pieces about this near hang together, metres")
    island: Weight = Field(0.0025, description="smaller islands take the id around them, square metres; 0 = they stay")
    fill: bool = Field(True, description="unseen surface takes the nearest id of its smooth region")
    crease: float = Field(30.0, gt=0, lt=180, description="smooth regions end where the surface turns more, degrees")
    other_size: Literal["nearest", "error"] = Field(
        "nearest", description="ids of another size than their view: take the nearest with a warning, or stop"
    )
    colour: Length = Field(
        0.25, description="of --geometry: regions end where colour jumps more, in natural logarithms"
    )
    smallest: Weight = Field(0.01, description="of --geometry: smaller regions join a neighbour, square metres")


class Background(Settings):
    """Light from outside: the radiance of rays that leave the mesh."""

    mode: Literal["auto", "none", "constant", "map", "given"] = Field(
        "auto",
        description="`none`: zero; `constant`, `map`: fitted to training pixels that see no surface; `given`: `file`; "
        "`auto`: `map` where enough pixels see outside, else `none`",
    )
    radiance: Rgb | None = Field(None, description="of mode `constant`, instead of a fitted one")
    file: str | None = Field(
        None, description="equirectangular map of mode `given`, EXR or HDR; {data_root} is replaced"
    )
    up: Literal["y", "z"] = Field("y", description="world axis towards the upper edge of the map")
    rotation: Angle = Field(0.0, description="turns `file` about that axis, degrees, counter-clockwise from above")
    resolution: Positive = Field(32, le=512, description="rows of a fitted map; it has twice as many columns")


class Cache(Settings):
    """Radiance cache over the surface."""

    resolution: int = Field(256, ge=8, le=1024, description="voxels along the scene box")


class Bake(Settings):
    """Shading of round 0, read from the cache."""

    sampling: Literal["shared", "separate"] = Field(
        "shared", description="one ray set for all shading outputs, or one lobe at a time as the paper"
    )
    diffuse_spp: Positive = Field(64, description="rays per hit from the cosine lobe")
    specular_spp: Positive = Field(16, description="rays per hit from each GGX lobe")
    smooth_spp: Positive = Field(16, description="rays per hit from the smoothest GGX lobe")
    denoise: bool = Field(True, description="denoise the shading images")
    fill: bool = Field(True, description="give unseen surface the light of the nearest seen one instead of black")
    seed: Count = Field(0, description="seed of the random numbers")


class Refine(Settings):
    """Shading of later rounds, path traced with the current materials and emitters."""

    sampling: Literal["shared", "separate"] = Field("shared", description="as of bake")
    diffuse_spp: Positive = Field(64, description="paths per hit from the cosine lobe")
    specular_spp: Positive = Field(16, description="paths per hit from each GGX lobe")
    smooth_spp: Positive = Field(16, description="paths per hit from the smoothest GGX lobe")
    light_sampling: bool = Field(True, description="sample emitters at the first hit too (the paper does not)")
    max_depth: Positive = Field(5, description="vertices after the first hit")
    cache_roughness: Fraction = Field(0.6, description="rougher vertices end the path in the radiance cache")
    damping: Fraction = Field(0.5, lt=1, description="share of the previous round's shading that is kept")
    denoise: bool = Field(True, description="denoise the shading images")
    seed: Count = Field(0, description="seed of the random numbers")


class Fit(Settings):
    """The BRDF and emission networks."""

    steps: Positive = Field(500, description="optimiser steps of a round")
    min_epochs: Weight = Field(0, description="at least this many passes over all training pixels")
    batch: Positive = Field(2048, description="pixels a step")
    queries: Positive = Field(2, le=4, description="material queries per hit and step, spread over its footprint")
    learning_rate: float = Field(5e-3, gt=0, le=1, description="of Adam")
    final_learning_rate: float = Field(2e-4, gt=0, le=1, description="reached by exponential decay at the last step")
    table_rate: float = Field(8.0, gt=0, le=100, description="learning rate of the hash table over the networks'")
    start_rough: bool = Field(True, description="start rough and not metallic instead of in the middle")
    evidence: Weight = Field(
        1.5, description="pixels this much brighter than any reflection teach only the mask; 0 = off, as the paper"
    )
    footprint: Weight = Field(0.5, description="size of a query in pixel footprints; finer levels fade; 0 = points")
    levels: Positive = Field(16, le=32, description="levels of the hash encoding")
    table_log2: int = Field(18, ge=8, le=24, description="log2 of the entries of a level")
    growth: float = Field(1.45, gt=1, le=2, description="resolution ratio of neighbouring levels")
    colour_weight: Weight = Field(1.0, description="of the difference to the pictures")
    emission_weight: Weight = Field(1.0, description="price of the emission mask")
    diffuse_weight: Weight = Field(1e-3, description="prior towards rough and not metallic")
    part_search: bool = Field(True, description="search roughness and metallic of whole segments before the fit")
    target_weight: Weight = Field(3e-3, description="pull towards what the search found")
    base_weight: Weight = Field(0.03, description="pull of parts that look like one colour towards it")
    hidden: Count = Field(512, description="points of unseen surface a step that are drawn to their part; 0 = off")
    part_weight: Weight = Field(2e-2, description="propagation within parts")
    semantic_weight: Weight = Field(1e-3, description="propagation within semantic segments")
    segments: Literal["auto", "part", "semantic", "none"] = Field("auto", description="which segment ids to use")
    warm_start: bool = Field(True, description="start a later round from the model before it")
    checkpoint_every: Positive = Field(250, description="steps between checkpoints")
    confidence: bool = Field(False, description="weight part search, propagation and pull by confidence in the surface")
    min_confidence: Fraction = Field(0.0, description="pixels of surface less sure than this teach nothing; 0 = all do")
    threads: Count = Field(0, description="CPU threads, 0 = all; 1 repeats bit for bit")
    seed: Count = Field(0, description="seed of the random numbers")


class Emitters(Settings):
    """Emitting triangles."""

    threshold: Fraction = Field(0.01, description="a triangle emits where its mean mask exceeds this")
    points: Positive = Field(100, description="points of a triangle at which the mask is queried")
    every_round: bool = Field(True, description="extract after every fit, not only the first")
    evidence: bool = Field(True, description="require more radiance than any reflectance could give")
    complete: bool = Field(True, description="unseen triangles of a part that glows wherever it is seen emit too")
    patches: bool = Field(True, description="one radiance for each connected lamp instead of each triangle")
    two_sided: bool = Field(True, description="emitters shine from both sides")


class Review(Settings):
    """The list of the lamps for people: names, pictures, and the file in which they decide."""

    width: int = Field(192, ge=32, le=1024, description="of a lamp's picture, pixels; its height is three quarters")


class Materials(Settings):
    """Material maps of every view."""

    average: bool = Field(True, description="average over the footprint instead of the pixel's centre")


class Render(Settings):
    """Held-out views, path traced with the model."""

    spp: Positive = Field(128, description="paths per pixel, spread over its rays; two a ray at least")
    max_depth: Positive = Field(6, description="vertices after the first hit")
    denoise: bool = Field(True, description="denoise the rendered views")
    seed: Count = Field(0, description="seed of the random numbers")


class EmitterEdit(Settings):
    """A change to found emitters."""

    index: Count | None = Field(None, description="number of a lamp in emitters.json; every lamp where none is chosen")
    name: str | None = Field(None, description="name of a lamp: `lamp-N`, or as emitters_review.yaml calls it")
    names: tuple[str, ...] | None = Field(None, description="names of several lamps", min_length=1)
    off: bool = Field(False, description="switch off")
    scale: Weight | None = Field(None, description="radiance factor; 0 switches off")
    color: Rgb | None = Field(None, description="new chromaticity; the luminance is kept")
    radiance: Rgb | None = Field(None, description="new radiance")

    @model_validator(mode="before")
    @classmethod
    def _yaml_off(cls, values: Any) -> Any:
        """YAML reads the key ``off`` as the value false."""
        return {"off" if key is False else key: v for key, v in values.items()} if isinstance(values, dict) else values

    @model_validator(mode="after")
    def _agrees(self) -> "EmitterEdit":
        """Refuse what says two things at once."""
        chosen = [key for key in ("index", "name", "names") if getattr(self, key) is not None]
        if len(chosen) > 1:
            raise ValueError(f"lamps are chosen by one of index, name and names, not by {' and '.join(chosen)}")
        changed = [key for key in ("scale", "color", "radiance") if getattr(self, key) is not None]
        if self.off and changed:
            raise ValueError(f"off: true leaves no light for {' and '.join(changed)}")
        return self

    @property
    def called(self) -> tuple[str, ...]:
        """Names by which the edit chooses lamps; none where it chooses by number, or all of them."""
        return self.names or ((self.name,) if self.name is not None else ())


Turn = Annotated[tuple[Angle, Angle, Angle], Field(description="degrees about x, then y, then z of the world")]

_LIGHT_KEYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "quad": (("radiance", "center"), ("normal", "size")),
    "sphere": (("radiance", "center"), ("radius",)),
    "mesh": (("radiance", "file"), ("position", "rotation", "scale")),
    "spot": (("intensity", "position"), ("direction", "target", "cone_angle", "soft_edge")),
}
"""Shape of a new light -> keys that it needs, keys that it may have."""


class NewLight(Settings):
    """A light to add: an area light (quad, sphere, mesh of a file) or a spot, which is a point."""

    shape: Literal["quad", "sphere", "mesh", "spot"] = Field(description="what shines")
    radiance: Rgb | None = Field(None, description="of quad, sphere and mesh")
    center: Point | None = Field(None, description="of quad and sphere, metres")
    normal: Point = Field((0.0, -1.0, 0.0), description="direction a quad faces")
    size: tuple[Length, Length] = Field((0.5, 0.5), description="sides of a quad, metres")
    radius: float = Field(0.1, gt=0, description="of a sphere, metres")
    file: str | None = Field(None, description="mesh: PLY, OBJ or GLB; {data_root} is replaced")
    position: Point = Field((0.0, 0.0, 0.0), description="of a spot; where the origin of a mesh's file comes to lie")
    rotation: Turn = Field((0.0, 0.0, 0.0), description="of a mesh, degrees about x, then y, then z of the world")
    scale: Length = Field(1.0, description="of a mesh: metres in a unit of its file")
    intensity: Rgb | None = Field(None, description="of a spot along its axis, watts per steradian")
    direction: Point | None = Field(None, description="along a spot's axis; or give its target")
    target: Point | None = Field(None, description="point on a spot's axis")
    cone_angle: float = Field(60.0, gt=0, le=178, description="of a spot's whole cone, edge to edge, degrees")
    soft_edge: float = Field(5.0, gt=0, le=89, description="degrees inside the edge over which a spot fades out")

    @model_validator(mode="after")
    def _complete(self) -> "NewLight":
        needed, allowed = _LIGHT_KEYS[self.shape]
        for key in needed:
            if getattr(self, key) is None or (key == "position" and "position" not in self.model_fields_set):
                raise ValueError(f"a {self.shape} light needs {key}")
        for key, field in type(self).model_fields.items():
            if key not in ("shape", *needed, *allowed) and getattr(self, key) != field.default:
                raise ValueError(f"a {self.shape} light has no {key}; it may have {', '.join(needed + allowed)}")
        if self.shape == "quad" and max(map(abs, self.normal)) < 1e-6:
            raise ValueError("the normal of a new quad light must not be zero")
        if self.shape == "spot":
            if (self.direction is None) == (self.target is None):
                raise ValueError("a spot needs either direction or target")
            axis = self.direction if self.target is None else tuple(map(sub, self.target, self.position))
            if not any(axis):
                raise ValueError("a spot's direction must not be zero, nor its target its position")
            if self.soft_edge > self.cone_angle / 2:
                raise ValueError(f"soft_edge must be at most half of cone_angle; found {self.soft_edge:g}")
        return self


Reflectance = Annotated[tuple[Fraction, Fraction, Fraction], Field(description="linear RGB, 0 to 1")]
Roughness = Annotated[float, Field(ge=0.02, le=1)]


class NewObject(Settings):
    """An object to put into the room."""

    file: str | None = Field(None, description="PLY, OBJ or GLB with its own materials; {data_root} is replaced")
    shape: Literal["sphere", "cube"] | None = Field(None, description="or one of these, around its own centre")
    size: Length = Field(0.3, description="of a shape: diameter of the sphere, side of the cube, metres")
    position: Point = Field(description="where the file's origin, or the shape's centre, comes to lie")
    rotation: Turn = Field((0.0, 0.0, 0.0), description="degrees about x, then y, then z of the world")
    scale: Length = Field(1.0, description="metres in a unit of the file")
    drop: bool = Field(False, description="falls straight down from there until it touches what is below")
    base_color: Reflectance | None = Field(None, description="instead of the object's own, linear RGB")
    roughness: Roughness | None = Field(None, description="instead of the object's own")
    metallic: Fraction | None = Field(None, description="instead of the object's own")

    @model_validator(mode="after")
    def _complete(self) -> "NewObject":
        if (self.file is None) == (self.shape is None):
            raise ValueError("an object needs either file or shape")
        return self


class BrushBox(Settings):
    """A box in the room."""

    center: Point
    size: tuple[Length, Length, Length] = Field(description="sides along x, y and z before it is turned, metres")
    rotation: Angle = Field(0.0, description="about the up axis, degrees, counter-clockwise from above")


class Removal(Settings):
    """What vanishes: a segment by its number or by a point of it, or what is in a box. One of the three."""

    segment: Count | None = Field(None, description="id of a fused segment, or of a connected part of the mesh")
    at: Point | None = Field(None, description="the segment or part of the surface nearest to this point")
    box: BrushBox | None = Field(None, description="triangles whose centre is in a box")

    @model_validator(mode="after")
    def _one(self) -> "Removal":
        if sum(value is not None for value in (self.segment, self.at, self.box)) != 1:
            raise ValueError("give one of segment, at and box")
        return self


class MaterialEdit(Removal):
    """Another material on a segment or in a box (chosen by one of segment, at, box)."""

    base_color: Reflectance | None = Field(None, description="instead of what was found, linear RGB")
    tint: Rgb | None = Field(None, description="factor on the base colour that was found; the result is at most 1")
    roughness: Roughness | None = Field(None, description="instead of what was found")
    metallic: Fraction | None = Field(None, description="instead of what was found")

    @model_validator(mode="after")
    def _some(self) -> "MaterialEdit":
        if self.base_color is not None and self.tint is not None:
            raise ValueError("give base_color or tint, not both")
        if all(value is None for value in (self.base_color, self.tint, self.roughness, self.metallic)):
            raise ValueError("give at least one of base_color, tint, roughness and metallic")
        return self


class BackgroundEdit(Settings):
    """A change to the light from outside."""

    file: str | None = Field(None, description="another map, EXR or HDR; {data_root} is replaced")
    radiance: Rgb | None = Field(None, description="one radiance for all directions instead of a map")
    scale: Weight | None = Field(None, description="radiance factor; 0 switches off")
    rotation: Angle = Field(0.0, description="turns the map about the up axis, degrees, counter-clockwise from above")


class Lens(Settings):
    """How a setup's own cameras see; what is absent is as in the dataset's first view."""

    fov: float | None = Field(None, ge=1, le=170, description="horizontal field of view, degrees")
    vertical_fov: float | None = Field(None, ge=1, le=170, description="the vertical one instead, degrees")
    width: int | None = Field(None, ge=1, le=16384, description="of the pictures, pixels")
    height: int | None = Field(None, ge=1, le=16384, description="of the pictures, pixels")
    up: Point | None = Field(
        None, description="direction to the upper edge; absent: the world axis nearest to up in the dataset's views"
    )

    @model_validator(mode="after")
    def _one_meaning(self) -> Self:
        if self.fov is not None and self.vertical_fov is not None:
            raise ValueError("give fov or vertical_fov, not both")
        if self.up is not None and max(map(abs, self.up)) < 1e-6:
            raise ValueError("up must have a length")
        return self


class LookAt(Lens):
    """A camera that stands anywhere."""

    position: Point
    target: Point = Field(description="world position in the middle of the picture, metres")

    @model_validator(mode="after")
    def _apart(self) -> Self:
        check_apart(self.position, self.target)
        return self


class Keyframe(Settings):
    """A place on a camera's way: a view of the dataset (its name alone will do), or position and target."""

    view: str | None = Field(None, description="name of a view of the dataset")
    position: Point | None = Field(None, description="world position, metres")
    target: Point | None = Field(None, description="world position in the middle of the picture, metres")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        return {"view": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.view is None) == (self.position is None) or (self.position is None) != (self.target is None):
            raise ValueError("a keyframe must be the name of a view, or position and target")
        if self.position is not None:
            check_apart(self.position, self.target)
        return self


class CameraPath(Lens):
    """A camera that moves smoothly through keyframes."""

    keyframes: tuple[Keyframe, ...] = Field(
        min_length=2, description="names of views, or sections with position and target"
    )
    frames: int = Field(ge=1, le=9_999, description="pictures along the way")
    fps: float = Field(24.0, gt=0, le=240, description="pictures a second of the video")
    loop: bool = Field(False, description="go on from the last keyframe to the first; the video can be repeated")
    timing: Literal["speed", "keyframes"] = Field(
        "speed", description="the same speed all the way, or the same time between neighbouring keyframes"
    )
    video: Literal["mp4", "png"] = Field("mp4", description="join the pictures into an MP4, or leave them as they are")


class OwnCameras(Settings):
    """Cameras of a setup instead of the dataset's."""

    look_at: dict[str, LookAt] | None = Field(None, min_length=1, description="name of a picture -> its camera")
    path: CameraPath | None = Field(None, description="cameras along a way, for a video")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.look_at is None) == (self.path is None):
            raise ValueError("cameras must have look_at or path, one of them")
        return self

    @property
    def names(self) -> list[str]:
        """Names of the pictures, in order."""
        if self.path is None:
            return list(self.look_at or {})
        return [f"frame-{number:04d}" for number in range(1, self.path.frames + 1)]


class RelightSetup(Settings):
    """The room under other light, with other things in it."""

    emitters: tuple[EmitterEdit, ...] = Field((), description="changes to found emitters, in order")
    lights: tuple[NewLight, ...] = Field((), description="lights to add")
    background: BackgroundEdit | None = Field(None, description="change of the light from outside")
    cameras: OwnCameras | None = Field(None, description="other cameras than the dataset's views")
    objects: tuple[NewObject, ...] = Field((), description="objects to put in, one after the other")
    materials: tuple[MaterialEdit, ...] = Field((), description="other materials, in order")
    remove: tuple[Removal, ...] = Field((), description="what vanishes, before anything is put in")
    reference: str | None = Field(
        None,
        description="folder of linear photographs under this light, EXR or HDR, named as the views, of any one "
        "exposure; relit views are compared with them; {data_root} is replaced",
    )

    @model_validator(mode="after")
    def _views_to_compare(self) -> Self:
        if self.cameras is not None and self.reference is not None:
            raise ValueError("reference is compared with views of the dataset; a setup with cameras renders none")
        return self

    @property
    def chooses_segments(self) -> bool:
        """Whether it names a segment, by number or by a point."""
        return any(entry.box is None for entry in (*self.materials, *self.remove))


class Relight(Settings):
    """Sampling of relit views."""

    split: Literal["train", "val", "all"] = Field("val", description="views to relight")
    spp: Positive = Field(128, description="paths per pixel, spread over its rays; two a ray at least")
    max_depth: Positive = Field(8, description="vertices after the first hit")
    denoise: bool = Field(True, description="denoise the rendered views")
    seed: Count = Field(0, description="seed of the random numbers")


class Video(Settings):
    """Pictures and videos of what a setup's own cameras see."""

    exposure: Length | None = Field(
        None, description="factor before the tone curve; absent: that of the report, by the dataset's photographs"
    )
    quality: int = Field(20, ge=0, le=51, description="of the MP4 (H.264 constant rate factor), lower is better")


class Lamps(Settings):
    """Views with each lamp alone, for the report's light mixer."""

    views: Count = Field(3, description="held-out views (training views where there are none); 0 = no light mixer")
    separate: Positive = Field(8, description="most powerful lamps that are rendered one by one; the rest together")
    spp: Positive = Field(256, description="paths per pixel and lamp, spread over its rays; two a ray at least")
    max_depth: Positive = Field(8, description="vertices after the first hit")
    denoise: bool = Field(True, description="denoise the rendered views")
    seed: Count = Field(0, description="seed of the random numbers")


class Export(Settings):
    """The room for other programs, and the check of its files."""

    enabled: bool = Field(False, description="export and check with every run; `export` as a target does it anyway")
    texel_density: Weight = Field(
        0.0, description="texels along a metre of surface; 0 = two along a pixel of the closer training views"
    )
    max_resolution: int = Field(4096, ge=64, le=16384, description="longest side of the textures, texels")
    samples: Positive = Field(2, le=8, description="a texel asks the model at the square of this many points")
    padding: Positive = Field(2, le=32, description="texels between charts of the atlas")
    point_size: Weight = Field(
        0.0,
        description="lamps smaller than this, metres, are point lights in glTF as well (KHR_lights_punctual); 0 = none",
    )
    check_views: Positive = Field(2, description="held-out views that the check renders from every format")
    check_spp: Positive = Field(256, description="paths per pixel of these")
    max_depth: Positive = Field(8, description="longest path of the Mitsuba scenes and of the check, segments")
    seed: Count = Field(0, description="seed of the check's random numbers")


class Metrics(Settings):
    """Figures against ground truth and photographs."""

    fit_exposure: bool = Field(False, description="fit one exposure scale before comparing renders (photographs)")


class Report(Settings):
    """The HTML page."""

    max_views: Positive = Field(12, description="views shown")
    width: Positive = Field(640, description="largest width of each picture, pixels")


STAGES: dict[str, type[Settings]] = {
    "synthesize": Synthesize,
    "capture": Capture,
    "poses": Poses,
    "import": Import,
    "check_poses": CheckPoses,
    "hits": Hits,
    "segment": Segment,
    "fuse": Fuse,
    "background": Background,
    "cache": Cache,
    "bake": Bake,
    "fit": Fit,
    "emitters": Emitters,
    "review": Review,
    "refine": Refine,
    "materials": Materials,
    "render": Render,
    "relight": Relight,
    "video": Video,
    "lamps": Lamps,
    "export": Export,
    "metrics": Metrics,
    "report": Report,
}
"""Config section -> model."""


def check_apart(position: tuple[float, ...], target: tuple[float, ...]) -> None:
    """Raise ValueError if a camera stands where it looks."""
    if max(abs(a - b) for a, b in zip(position, target, strict=True)) < 1e-6:
        raise ValueError("position and target must be apart, so that there is a direction to look in")


def check_keyframes(path: CameraPath, views: Sequence[str]) -> None:
    """Raise FiptError if a keyframe names none of the ``views``."""
    for key in path.keyframes:
        if key.view is not None and key.view not in views:
            close = get_close_matches(key.view, views, n=3, cutoff=0.3) or list(views[:3])
            raise FiptError(
                f"a camera path goes through view {key.view!r}, which there is not", f"use {', '.join(close)}"
            )


def check_background(settings: Background, where: str = "background") -> Background:
    """Return the settings if their keys go together; ``where`` names the section in errors.

    Raises
    ------
    FiptError
        If mode `given` has no file, or a key is given that the mode does not use.
    """
    if settings.mode == "given" and settings.file is None:
        raise FiptError(f"{where}.mode is given, but background.file is missing", "name an EXR or HDR environment map")
    for key, mode in (("file", "given"), ("radiance", "constant")):
        if getattr(settings, key) is not None and settings.mode != mode:
            raise FiptError(
                f"{where}.{key} is only for mode {mode}; mode is {settings.mode}", f"set {where}.mode: {mode}"
            )
    return settings


def check_segment(settings: Segment, where: str = "segment") -> Segment:
    """Return the settings if their keys go together; ``where`` names the section in errors.

    Raises
    ------
    FiptError
        If mode `given` has no path, or another mode has one.
    """
    if settings.mode == "given" and settings.path is None:
        raise FiptError(
            f"{where}.mode is given, but {where}.path is missing", "name a folder of ids, or labelled triangles"
        )
    if settings.path is not None and settings.mode != "given":
        raise FiptError(f"{where}.path is only for mode given; mode is {settings.mode}", f"set {where}.mode: given")
    return settings


def explain(error: ValidationError, where: str) -> str:
    """Return one line for the first problem of a pydantic error: key path, what is allowed, what was found."""
    problem = error.errors()[0]
    path = ".".join([where, *(str(part) for part in problem["loc"])])
    if problem["type"] == "value_error":  # keys that do not go together
        return f"{path}: {problem['ctx']['error']}"
    if problem["type"] == "extra_forbidden":
        return f"unknown key {path}"
    text = problem["msg"]
    return f"{path}: {text[0].lower()}{text[1:]}; found {problem.get('input')!r}"


def parse(stage: str, text: str) -> Any:
    """Parse the JSON of ``--settings`` into the stage's model.

    Raises
    ------
    FiptError
        If it is not JSON, has unknown keys or values out of range.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise FiptError(f"--settings must be JSON ({error})", "give for example '{}'") from error
    return validated(stage, values)


def validated(stage: str, values: Mapping[str, Any]) -> Any:
    """Check ``values`` against the stage's model and return it."""
    model = STAGES[stage]
    try:
        return model.model_validate(values)
    except ValidationError as error:
        allowed = ", ".join(model.model_fields)
        raise FiptError(explain(error, stage), f"allowed keys of {stage}: {allowed}") from error


def parse_setup(text: str) -> RelightSetup:
    """Read a light setup: JSON, or the path of a YAML file with the same keys.

    Raises
    ------
    FiptError
        If it is neither, has unknown keys or values out of range.
    """
    try:
        if text.lstrip().startswith("{"):
            return RelightSetup.model_validate_json(text)
        return RelightSetup.model_validate(_yaml(text))
    except ValidationError as error:
        allowed = ", ".join(RelightSetup.model_fields)
        raise FiptError(explain(error, "setup"), f"allowed keys of a light setup: {allowed}") from error


def parse_cameras(text: str) -> OwnCameras:
    """Parse the JSON of a setup's own cameras.

    Raises
    ------
    FiptError
        If it is not JSON, has unknown keys or values out of range.
    """
    try:
        return OwnCameras.model_validate_json(text)
    except ValidationError as error:
        raise FiptError(explain(error, "cameras"), "give look_at or path, see config/README.md") from error


def _yaml(path: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise FiptError(
            f"the light setup must be JSON or the path of a YAML file; {path} cannot be read ({error.strerror})",
            "check the path",
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise FiptError(f"the light setup {path} is not YAML ({error})", "repair the file") from error


def dumped(settings: Settings) -> dict[str, Any]:
    """Settings as plain JSON types."""
    return json.loads(settings.model_dump_json())


PRESETS = Path(__file__).resolve().parent.parent / "config" / "presets"
