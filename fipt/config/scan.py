"""A sheet of the rooms that lie in a folder: captures, data sets, scene files."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping
from pathlib import Path

from fipt.config.reading import CONFIG_FILE, load
from fipt.config.sheet import write_sheet
from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.stages.capture.folder import photographs
from fipt.stages.capture.table import TABLE

SHEET_FILE = "rooms.tsv"
"""The sheet that is written, in the working directory of the runs."""

_CONFIG = f"""# The rooms stand in {SHEET_FILE}, a line each. `fipt run all` in this folder runs them.
# config/README.md in the sources has every key. Paths are relative to this folder, or absolute.

scenes: {SHEET_FILE}

rounds: 4             # most refinements after the first fit; fewer where it settles
"""


def write_rooms(folder: Path, scanned: Path) -> list[str]:
    """Write a sheet of the rooms below a folder, and a configuration that names it; return the rooms' names.

    Raises
    ------
    FiptError
        If there is one already, or there are no rooms.
    """
    sheet, config = folder / SHEET_FILE, folder / CONFIG_FILE
    for file in (sheet, config):
        if file.exists():
            raise FiptError(f"{file} exists already", "choose another folder, or edit that file")
    if not scanned.is_dir():
        raise FiptError(f"there is no folder {scanned}", "check the path")
    rooms: dict[str, Mapping[str, str]] = {}
    for place, keys in _rooms(scanned):
        name = _name(scanned, place)
        if name in rooms:
            raise FiptError(f"{place} and {rooms[name]['path']} would both be called {name}", "rename one of them")
        rooms[name] = {"source": keys["source"], "path": _written(folder, place), "preset": "default"} | keys
    if not rooms:
        raise FiptError(f"{scanned} holds no capture, no dataset and no scene file", "check the path")
    write_sheet(sheet, rooms)
    try:
        for name, scene in load({"scenes": str(sheet)}).scenes.items():  # what cannot be is told now
            scene.place.plain(rooms[name]["path"], "path")
    except FiptError:
        sheet.unlink()
        raise
    write_text(config, _CONFIG)
    return list(rooms)


def _rooms(scanned: Path) -> list[tuple[Path, dict[str, str]]]:
    """Every place below a folder that is a room, with what it is; nothing is looked for inside a room.

    Each folder is looked at once, however many links lead there, and by its own name where it has one below.
    """
    rooms: list[tuple[Path, dict[str, str]]] = []
    seen: set[Path] = set()
    waiting = deque([scanned])
    while waiting:
        folder = waiting.popleft()
        if (place := folder.resolve()) in seen:
            continue
        seen.add(place)
        keys = _kind(folder)
        if keys is not None:
            rooms.append((folder / "scene.xml" if keys["source"] == "mitsuba" else folder, keys))
            continue
        for path in _folders(folder):
            if path.is_symlink():
                waiting.append(path)
            else:
                waiting.appendleft(path)
    return sorted(rooms, key=lambda room: room[0])


def _folders(folder: Path) -> list[Path]:
    """Folders in a folder, links to folders too, without hidden ones."""
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError as error:
        raise FiptError(f"{folder} cannot be read ({error.strerror})", "correct its permissions, or move it") from error


def _kind(folder: Path) -> dict[str, str] | None:
    """What a scene says of a folder, by the names of its files; None: it is no room."""
    if (folder / "transforms.json").is_file():
        return {"source": "dataset", "format": "fipt" if (folder / "views.json").is_file() else "nerfstudio"}
    if (folder / "transforms_train.json").is_file():
        return {"source": "dataset", "format": "nerfstudio"}
    if (folder / "train" / "transforms.json").is_file():
        return {"source": "dataset", "format": "fipt-synthetic"}
    if (folder / "cam.txt").is_file() and (folder / "K_list.txt").is_file():
        return {"source": "dataset", "format": "fipt-real"}
    if (folder / "scene.xml").is_file():
        return {"source": "mitsuba"}
    if (folder / TABLE).is_file() or _holds_raw(folder):
        return {"source": "raw", "poses": "colmap"}
    return None


def _holds_raw(folder: Path) -> bool:
    """Whether RAW files lie in a folder; images of other kinds may be anything."""
    try:
        return photographs(folder)[0] == "raw"
    except FiptError:
        return False


def _name(scanned: Path, place: Path) -> str:
    folder = place.parent if place.suffix == ".xml" else place
    below = folder.relative_to(scanned)
    text = "-".join(below.parts) or scanned.resolve().name
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("_.-")[:100] or "room"


def _written(folder: Path, place: Path) -> str:
    """A path as the sheet has it: below the folder relative to it, elsewhere absolute."""
    whole, base = place.expanduser().resolve(), folder.resolve()
    return str(whole.relative_to(base) if whole.is_relative_to(base) else whole)
