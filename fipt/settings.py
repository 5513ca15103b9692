"""Settings of every stage: frozen models whose defaults are the preset ``default``; unknown keys are errors."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

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

    steps: Positive = Field(500, description="optimiser steps of a round; at least two epochs where min_epochs is 2")
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

    index: Count | None = Field(None, description="emitter index in emitters.json; all where absent")
    scale: Weight | None = Field(None, description="radiance factor; 0 switches off")
    color: Rgb | None = Field(None, description="new chromaticity; the luminance is kept")
    radiance: Rgb | None = Field(None, description="new radiance")


class NewLight(Settings):
    """An area light to add."""

    shape: Literal["quad", "sphere"] = Field(description="what shines")
    radiance: Rgb
    center: Point
    normal: Point = Field((0.0, -1.0, 0.0), description="direction a quad faces")
    size: tuple[Length, Length] = Field((0.5, 0.5), description="sides of a quad, metres")
    radius: float = Field(0.1, gt=0, description="of a sphere, metres")


class BackgroundEdit(Settings):
    """A change to the light from outside."""

    file: str | None = Field(None, description="another map, EXR or HDR; {data_root} is replaced")
    radiance: Rgb | None = Field(None, description="one radiance for all directions instead of a map")
    scale: Weight | None = Field(None, description="radiance factor; 0 switches off")
    rotation: Angle = Field(0.0, description="turns the map about the up axis, degrees, counter-clockwise from above")


class RelightSetup(Settings):
    """The room under other light."""

    emitters: tuple[EmitterEdit, ...] = Field((), description="changes to found emitters, in order")
    lights: tuple[NewLight, ...] = Field((), description="lights to add")
    background: BackgroundEdit | None = Field(None, description="change of the light from outside")


class Relight(Settings):
    """Sampling of relit views."""

    split: Literal["train", "val", "all"] = Field("val", description="views to relight")
    spp: Positive = Field(128, description="paths per pixel, spread over its rays; two a ray at least")
    max_depth: Positive = Field(8, description="vertices after the first hit")
    denoise: bool = Field(True, description="denoise the rendered views")
    seed: Count = Field(0, description="seed of the random numbers")


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
    "refine": Refine,
    "materials": Materials,
    "render": Render,
    "relight": Relight,
    "lamps": Lamps,
    "export": Export,
    "metrics": Metrics,
    "report": Report,
}
"""Config section -> model."""


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
    if problem["type"] == "extra_forbidden":
        return f"unknown key {path}"
    return f"{path}: {problem['msg'][0].lower()}{problem['msg'][1:]}; found {problem.get('input')!r}"


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
    """Parse the JSON of a light setup.

    Raises
    ------
    FiptError
        If it is not JSON, has unknown keys or values out of range.
    """
    try:
        return RelightSetup.model_validate_json(text)
    except ValidationError as error:
        allowed = ", ".join(RelightSetup.model_fields)
        raise FiptError(explain(error, "setup"), f"allowed keys of a light setup: {allowed}") from error


def dumped(settings: Settings) -> dict[str, Any]:
    """Settings as plain JSON types."""
    return json.loads(settings.model_dump_json())


PRESETS = Path(__file__).resolve().parent.parent / "config" / "presets"
