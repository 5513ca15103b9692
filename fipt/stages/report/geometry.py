"""The section of the page on a mesh that was made of the photographs: what speaks for it, and where little does."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED
from fipt.stages.report import images
from fipt.stages.report.files import read_json

_WIDTH = 1200
"""Of the picture, pixels."""


@dataclass(frozen=True)
class GeometryReport:
    """What the page says about the mesh.

    Attributes
    ----------
    words
        What speaks for it.
    caption
        Of the picture.
    bare
        Names of views of which more is closed than known.
    image
        Data URI, width, height; None where there is none.
    """

    words: str
    caption: str
    bare: list[str]
    image: tuple[str, int, int] | None


def read_geometry(folder: Path) -> GeometryReport | None:
    """Read what ``fipt mesh`` wrote; None where there is nothing."""
    path = folder / "geometry.json"
    content = read_json(path)
    if content is None:
        return None
    try:
        image = _image(folder / "overview.png")
        if "registration" in content:
            return GeometryReport(_of_scan(content["registration"]), _SCAN, [], image)
        bare = [name for name, shares in content["of_view"].items() if shares["closed"] > shares["known"]]
        return GeometryReport(_of_depth(content), _DEPTH, bare, image)
    except MALFORMED as error:
        raise FiptError(f"{path} is not what fipt mesh writes ({error!r})", "run fipt mesh again") from error


_DEPTH = (
    "Photograph, depth, and where it comes from: blue the view's own, grey planes, orange walls. "
    "Views with most orange come first."
)
_SCAN = (
    "Photograph, depth of the scan, and what the photographs say: blue the same, orange another depth, grey nothing. "
    "Views with most orange come first."
)


def _of_depth(content: dict[str, Any]) -> str:
    """Words for a mesh of depth maps."""
    surface = content["surface"]
    return (
        f"The mesh was made of the photographs. Of their pixels {100 * content['known']:.0f} % have a depth of their "
        f"own, {100 * content['completed']:.0f} % lie on planes that go on from others, and "
        f"{100 * content['closed']:.0f} % show a wall of the room for want of anything else, or nothing. Depth "
        f"deviates by {content['noise_mm_at_1m']:.2g} mm at 1 m; voxels have {content['voxel_mm']:.0f} mm; "
        f"{content['planes']} planes were found. Of its surface {100 * surface['measured']:.0f} % is seen with a depth "
        f"of its own, {100 * surface['completed']:.0f} % lies on planes that go on, {100 * surface['closed']:.0f} % on "
        f"walls that nothing else tells, and {100 * surface['unseen']:.0f} % is in no view."
    )


def _of_scan(placed: dict[str, Any]) -> str:
    """Words for a scan."""
    return (
        f"The mesh is a scan, brought to the cameras: turned by {placed['turned']:.1f} degrees and moved by "
        f"{placed['moved']:.2f} m. Of the places whose depth the photographs tell, {100 * placed['share']:.0f} % lie "
        f"on it, at a median distance of {placed['residual_mm']:.1f} mm."
    )


def _image(path: Path) -> tuple[str, int, int] | None:
    from PIL import Image

    if not path.is_file():
        return None
    with Image.open(path) as opened:
        return images.embedded(np.array(opened.convert("RGB")), _WIDTH)
