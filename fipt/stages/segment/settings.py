"""Settings of segment ids: of single views, and fused on the mesh."""

from typing import Literal

from pydantic import Field

from fipt.errors import FiptError
from fipt.settings import Count, Fraction, Length, Positive, Settings, Weight


class SegmentSettings(Settings):
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


class FuseSettings(Settings):
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


def check_segment(settings: SegmentSettings, where: str = "segment") -> SegmentSettings:
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
