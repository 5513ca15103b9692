"""Settings of the depth maps of posed views."""

from pathlib import Path

from pydantic import Field

from fipt.settings import Count, Fraction, Length, Positive, Settings

STEREO = "none"
"""What `depth.given` says where depth maps that a layout names are not to be used."""


class DepthSettings(Settings):
    """Depth of posed views, from how a surface moves between them, or of files that exist."""

    sources: Positive = Field(default=5, ge=3, le=8, description="other views that each view is matched with, at most")
    consistent_views: Positive = Field(default=2, description="other views that must confirm the depth of a pixel")
    correlation: Fraction = Field(default=0.5, description="correlation with its sources that a pixel needs")
    nearest: Length = Field(default=0.3, description="distance of the nearest surface from a camera, metres")
    rounds: Positive = Field(default=6, description="rounds of refinement on the smallest pictures")
    later_rounds: Positive = Field(default=4, description="rounds of refinement on each larger size")
    memory_gb: Length = Field(default=12.0, description="memory above which depth is refused before it starts")
    poor: Fraction = Field(
        default=0.05, description="a view with a smaller share of known pixels is named in a warning"
    )
    given: str | None = Field(
        default=None,
        description="folder of depth maps that exist, VIEW.exr or VIEW.png, in place of stereo; absent: those that a "
        "nerfstudio layout names (depth_file_path), if any; `none`: stereo; {data_root} is replaced",
    )
    unit: Length = Field(default=0.001, description="metres of one unit of a PNG that is given")
    seed: Count = Field(default=0, description="seed of the planes that are tried")


def given_file(folder: Path, view: str) -> Path:
    """File of a view's depth that exists: EXR, else PNG."""
    exr = folder / f"{view}.exr"
    return exr if exr.is_file() else folder / f"{view}.png"
