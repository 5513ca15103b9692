"""A room that someone modelled: the content of a scene file as a `SyntheticRoom`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.scene.cameras import Camera
from fipt.synthetic.room import RoomPiece, SyntheticRoom, assemble
from fipt.synthetic.scenefile.scene import SceneContent, read_scene
from fipt.synthetic.settings import SynthesizeSettings
from fipt.synthetic.views import render_probes

MIDDLE = 0.25
"""Median over the views of their median luminance, after exposure."""


def modelled(path: Path, settings: SynthesizeSettings) -> SyntheticRoom:
    """Read a scene file.

    Parameters
    ----------
    path
        The XML file.
    settings
        Section ``scene``: how it is read.
    """
    return room_of(read_scene(path, settings.scene), path.name)


def room_of(content: SceneContent, name: str) -> SyntheticRoom:
    """Return what a scene file holds as a room: a part for each surface, a semantic id for each material."""
    pieces = [
        RoomPiece(s.name, s.vertices, s.triangles, s.uv, s.material, s.material, s.radiance) for s in content.surfaces
    ]
    names = [material.name for material in content.materials]
    facts = {"source": name, "notes": content.notes}
    return assemble(pieces, content.materials, names, content.box, content.environment, facts=facts)


def exposure_of(room: SyntheticRoom, cameras: Sequence[Camera], settings: SynthesizeSettings) -> float:
    """Factor on the light with which the median over views of their median luminance is `MIDDLE`, six digits.

    Measured on small, quickly rendered images of a few of the cameras.
    """
    weights = np.array(LUMINANCE, np.float32)
    medians = [float(np.median(image @ weights)) for image in render_probes(room, cameras, settings)]
    middle = float(np.median(medians))
    if not middle > 0:
        raise FiptError(
            f"no light reaches what the views show: their median luminance is {middle:g}",
            "check the scene's lights, and whether something stands before them",
        )
    return float(f"{MIDDLE / middle:.6g}")
