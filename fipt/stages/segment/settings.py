"""Settings of segment ids: of single views, and fused on the mesh."""

from typing import Annotated, Literal

from pydantic import Field

from fipt.settings import Count, Fraction, Length, Positive, Settings, Weight, by_mode


class _Segments(Settings):
    """Segment ids of the training views: where they come from."""


class AutoSegments(_Segments):
    """The dataset's own ids, `geometry` where it has none."""

    mode: Literal["auto"] = "auto"


class PredictedSegments(_Segments):
    """A network per view, fused on the mesh."""

    mode: Literal["mask2former"] = "mask2former"
    model: str = Field(
        default="facebook/mask2former-swin-large-coco-panoptic",
        description="checkpoint of Mask2Former in the local cache, or a folder; {data_root} is replaced",
    )
    task: Literal["panoptic", "semantic"] = Field(default="panoptic", description="objects of a class apart, or as one")
    exposure: Length = Field(
        default=1.0, description="factor on the radiance that the network sees, before its gamma of 1/2.2"
    )
    score: Fraction = Field(default=0.8, description="least probability of the class of a panoptic segment")
    overlap: Fraction = Field(default=0.8, description="least share of a panoptic segment that others leave it")
    batch: Positive = Field(default=1, le=64, description="views that the network sees at once")
    half: bool = Field(default=True, description="half precision where there is CUDA")
    threads: Count = Field(default=0, description="CPU threads of the network, 0 = all")


class GivenSegments(_Segments):
    """From `path`, fused on the mesh."""

    mode: Literal["given"] = "given"
    path: str = Field(
        description="of mode `given`: a folder of ids by view (PNG, EXR), or labels of the mesh's triangles (PLY, NPZ)"
        "; {data_root} is replaced",
    )
    property: str = Field(
        default="segment", description="property of a PLY's faces, or array of an NPZ, that holds the labels"
    )
    other_size: Literal["nearest", "error"] = Field(
        default="nearest",
        description="given ids of another size than their view: take the nearest with a warning, or stop",
    )


class DegradedSegments(_Segments):
    """The dataset's own, made worse in each view, then fused on the mesh: for comparisons."""

    mode: Literal["degraded"] = "degraded"
    noise: Fraction = Field(default=0.15, description="of mode `degraded`: share of pixels with any id of the view")
    shift: Weight = Field(default=3.0, description="of mode `degraded`: edges are moved by up to so many pixels")
    seed: Count = Field(default=0, description="of mode `degraded`: seed of the random numbers")


class GrownSegments(_Segments):
    """Grown on the mesh."""

    mode: Literal["geometry"] = "geometry"


class NoSegments(_Segments):
    """Fit without."""

    mode: Literal["none"] = "none"


_AnyMode = AutoSegments | PredictedSegments | GivenSegments | DegradedSegments | GrownSegments | NoSegments
SegmentSettings = Annotated[_AnyMode, Field(discriminator="mode"), by_mode(_AnyMode)]


class FuseSettings(Settings):
    """Segment ids of single views to ids on the mesh."""

    vote: Literal["area", "count"] = Field(
        default="area", description="a pixel's vote: its cosine of the viewing angle, or one (`count`, as the paper)"
    )
    associate: Literal["overlap", "ids", "classes"] = Field(
        default="overlap",
        description="segments of different views are one by their overlap on the mesh, by the same id, or by class",
    )
    overlap: float = Field(
        default=0.25,
        gt=0,
        lt=1,
        description="of the surface that two views see: intersection over union that speaks for one",
    )
    speckles: bool = Field(
        default=True, description="pixels that agree with fewer than two of eight around do not vote"
    )
    sharpen: Count = Field(
        default=3, le=20, description="passes that give votes near edges to the cells they belong to"
    )
    split: bool = Field(
        default=True, description="cut large triangles for the votes, so that segments may end inside them"
    )
    cell: Weight = Field(default=0.0, description="longest side of the pieces, metres; 0 = two pixel widths")
    most_cells: Positive = Field(
        default=1_000_000, le=20_000_000, description="pieces are larger where there would be more"
    )
    pieces: Literal["auto", "all", "none"] = Field(
        default="auto",
        description="segments that do not hang together are one part a piece: those of classes of which no view shows "
        "two, all, or none",
    )
    gap: Length = Field(default=0.1, description="pieces about this near hang together, metres")
    island: Weight = Field(
        default=0.0025, description="smaller islands take the id around them, square metres; 0 = they stay"
    )
    fill: bool = Field(default=True, description="unseen surface takes the nearest id of its smooth region")
    crease: float = Field(
        default=30.0, gt=0, lt=180, description="smooth regions end where the surface turns more, degrees"
    )
    other_size: Literal["nearest", "error"] = Field(
        default="nearest", description="ids of another size than their view: take the nearest with a warning, or stop"
    )
    color: Length = Field(
        default=0.25, description="of --geometry: regions end where colour jumps more, in natural logarithms"
    )
    smallest: Weight = Field(default=0.01, description="of --geometry: smaller regions join a neighbour, square metres")


class RegroupSettings(Settings):
    """Segments of two materials are cut, and those of one material become one part, in every round."""

    ids: Literal["none", "grown", "fused", "all"] = Field(
        default="grown",
        description="which ids are joined: those grown on the mesh, also those of a network or given (`fused`), also "
        "the dataset's (`all`)",
    )
    divide: bool = Field(default=True, description="cut segments that the pictures show to be of two materials first")
    borders: bool = Field(
        default=True, description="then move borders of parts to where the pictures show their materials meet"
    )
