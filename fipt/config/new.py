"""The configuration of a new room, with comments."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from string import Template

from fipt.config.reading import CONFIG_FILE, load
from fipt.config.sources.base import ESTIMATED, RECONSTRUCTED
from fipt.errors import FiptError
from fipt.formats.files import check_name, write_text
from fipt.formats.yaml import parse_yaml

log = logging.getLogger(__name__)

TEMPLATES = Path(__file__).resolve().parent / "templates"
"""Folder of the configurations, one for each source."""

SOURCES = ("raw", "dataset", "mitsuba", "procedural")

_PLACES = {"raw": "photos", "dataset": "dataset", "mitsuba": "scene.xml"}
"""Source -> where its data are where nobody says."""

_SAID_OF = {
    "path": ("raw", "dataset", "mitsuba"),
    "mesh": ("raw", "dataset"),
    "poses": ("raw",),
    "format": ("dataset",),
}
"""What may be said of a new room -> sources of which it may be."""


@dataclass(frozen=True, kw_only=True)
class NewRoom:
    """What is known of a new room.

    Attributes
    ----------
    source
        Where its data come from, one of `SOURCES`.
    name
        Of the scene.
    path, mesh
        Its data, a name to be replaced by hand where it is None; and its mesh, made of the images where it is.
    poses
        Of photographs: ``colmap``, as where it is None, or a file.
    format
        Layout of a dataset; None: nerfstudio.
    """

    source: str = "raw"
    name: str = "room"
    path: Path | None = None
    mesh: Path | None = None
    poses: str | None = None
    format: str | None = None


def write_config(folder: Path, room: NewRoom) -> Path:
    """Write the configuration of a new room, config/config.yaml in a folder; return its path.

    Raises
    ------
    FiptError
        If there is one already, or what is said of the room cannot be.
    """
    check_name(room.name, "scene")
    if room.source not in SOURCES:
        raise FiptError(f"there is no source {room.source!r}", f"sources: {', '.join(SOURCES)}")
    for key, only in _SAID_OF.items():
        if getattr(room, key) is not None and room.source not in only:
            raise FiptError(f"--{key} is only for source {' or '.join(only)}; source is {room.source}", f"omit --{key}")
    file = folder / CONFIG_FILE
    if file.exists():
        raise FiptError(f"{file} exists already", "choose another folder, or edit that file")
    text = config_text(folder, room)
    (scene,) = load(parse_yaml(text)).scenes.values()  # what cannot be is told now
    poses = None if room.poses in (None, ESTIMATED) else Path(room.poses)
    for key, path in (("path", room.path), ("mesh", room.mesh), ("poses", poses)):
        if path is not None:
            scene.place.plain(str(path), key)
        if path is not None and not path.expanduser().exists():
            log.warning("--%s: %s is not there yet", key, path)
    write_text(file, text)
    return file


def config_text(folder: Path, room: NewRoom) -> str:
    """Configuration of a new room, for a folder in which it will be run."""
    template = Template((TEMPLATES / f"{room.source}.yaml").read_text(encoding="utf-8"))
    poses = ESTIMATED if room.poses in (None, ESTIMATED) else _written(folder, Path(room.poses))
    return template.substitute(
        name=room.name if room.name[0].isalpha() and parse_yaml(room.name) == room.name else json.dumps(room.name),
        path=_written(folder, room.path) if room.path else _PLACES.get(room.source, ""),
        mesh=_written(folder, room.mesh) if room.mesh else "mesh.ply" if room.source == "dataset" else RECONSTRUCTED,
        mesh_comment="" if room.mesh else "# ",
        poses=poses,
        format=json.dumps(room.format or "nerfstudio"),
    )


def _written(folder: Path, path: Path) -> str:
    """A path as the configuration has it: below the folder relative to it, elsewhere absolute."""
    whole, base = path.expanduser().resolve(), folder.resolve()
    return json.dumps(str(whole.relative_to(base) if whole.is_relative_to(base) else whole), ensure_ascii=False)
