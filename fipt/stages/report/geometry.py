"""The section of the page on a mesh that was made of the photographs: what speaks for it, and where little does."""

from dataclasses import dataclass
from pathlib import Path

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
    known, completed, closed
        Shares of the pixels with depth of their own, of planes, and of walls for want of anything else, 0 to 1.
    noise, voxel
        Deviation of depth at one metre, and side of a voxel, millimetres.
    planes
        Number of planes.
    bare
        Names of views of which more is closed than known.
    image
        Data URI, width, height; None where there is none.
    """

    known: float
    completed: float
    closed: float
    noise: float
    voxel: float
    planes: int
    bare: list[str]
    image: tuple[str, int, int] | None


def read_geometry(folder: Path) -> GeometryReport | None:
    """Read what ``fipt mesh`` wrote; None where there is nothing."""
    path = folder / "geometry.json"
    content = read_json(path)
    if content is None:
        return None
    try:
        return GeometryReport(
            known=float(content["known"]),
            completed=float(content["completed"]),
            closed=float(content["closed"]),
            noise=float(content["noise_mm_at_1m"]),
            voxel=float(content["voxel_mm"]),
            planes=len(content["planes"]),
            bare=[name for name, shares in content["of_view"].items() if shares["closed"] > shares["known"]],
            image=_image(folder / "overview.png"),
        )
    except MALFORMED as error:
        raise FiptError(f"{path} is not what fipt mesh writes ({error!r})", "run fipt mesh again") from error


def _image(path: Path) -> tuple[str, int, int] | None:
    from PIL import Image

    if not path.is_file():
        return None
    with Image.open(path) as opened:
        return images.embedded(np.array(opened.convert("RGB")), _WIDTH)
