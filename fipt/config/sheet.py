"""A sheet of rooms: a table that stands where the configuration has the mapping ``scenes``.

One line a room, columns parted by tabs. The first line has their names: ``name``, and keys of a scene, those of inner
sections with dots (``settings.fit.steps``). An empty cell says nothing; lines that begin with # are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from fipt.config.files import merge
from fipt.config.schema import SceneEntry
from fipt.errors import FiptError
from fipt.formats.files import check_name, write_text
from fipt.formats.text import read_text
from fipt.formats.yaml import parse_yaml
from fipt.validation import checked, kinds_of

NAME = "name"
_TRUTH = ("true", "false")


@dataclass(frozen=True)
class RoomSheet:
    """The rooms of a sheet.

    Attributes
    ----------
    path
        The file, as the configuration names it.
    columns
        Names of the columns.
    lines
        Room -> its line, counted from 1.
    scenes
        Room -> what a mapping ``scenes`` would say about it.
    """

    path: str
    columns: tuple[str, ...]
    lines: Mapping[str, int]
    scenes: Mapping[str, Any]

    def located(self, name: str, error: FiptError) -> FiptError:
        """An error that is about a room, with the line and the column that it comes from."""
        named = [column for column in self.columns[1:] if _mentions(error.message, name, column)]
        column = max(named, key=len, default=None)
        return FiptError(f"{self._place(self.lines[name], column)}: {error.message}", error.remedy)

    def _place(self, line: int, column: str | None) -> str:
        number = "" if column is None else f", column {self.columns.index(column) + 1} ({column})"
        return f"{self.path}, line {line}{number}"


def read_sheet(path: str) -> RoomSheet:
    """Read a sheet of rooms and check every line like an entry of the configuration.

    Raises
    ------
    FiptError
        One line with the file, the line and the column: of a column that is no key, a name that is there again, a cell
        too many, a value that cannot be.
    """
    rows = list(_rows(path))
    if len(rows) < 2:
        raise FiptError(f"{path} has no room", "give a line with the names of the columns, and one for each room")
    head, cells = rows[0]
    columns = tuple(cell.strip() for cell in cells)
    _check_columns(path, head, columns)
    lines: dict[str, int] = {}
    scenes: dict[str, Any] = {}
    sheet = RoomSheet(path, columns, lines, scenes)
    for line, cells in rows[1:]:
        name = cells[0].strip()
        where = f"{path}, line {line}"
        if len(cells) > len(columns):
            raise FiptError(f"{where}: {len(cells)} cells in {len(columns)} columns", "part cells by one tab each")
        try:
            check_name(name, "scene")
        except FiptError as error:
            raise FiptError(f"{where}, column 1 ({NAME}): {error.message}", error.remedy) from None
        if name in lines:
            raise FiptError(f"{where}: the room {name!r} of line {lines[name]} is there again", "give it another name")
        lines[name] = line
        scenes[name] = _entry(where, columns, cells)
        try:
            checked(SceneEntry, scenes[name], root=f"scenes.{name}")
        except FiptError as error:
            raise sheet.located(name, error) from None
    return sheet


def write_sheet(path: Path, rooms: Mapping[str, Mapping[str, str]]) -> None:
    """Write a sheet of rooms whose keys have plain values."""
    columns = list(dict.fromkeys(key for keys in rooms.values() for key in keys))
    lines = [[NAME, *columns], *([name, *(keys.get(key, "") for key in columns)] for name, keys in rooms.items())]
    for cell in (cell for cells in lines for cell in cells):
        if "\t" in cell or "\n" in cell or "\r" in cell:
            raise FiptError(f"{cell!r} cannot stand in a sheet: it holds a tab or a line end", "rename it")
    write_text(path, "".join("\t".join(cells) + "\n" for cells in lines))


def _rows(path: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line that says something; any kind of line end."""
    text = read_text(path, "the sheet of rooms").replace("\r\n", "\n").replace("\r", "\n")
    for number, line in enumerate(text.split("\n"), 1):
        if line.strip() and not line.startswith("#"):
            yield number, line.split("\t")


def _check_columns(path: str, line: int, columns: tuple[str, ...]) -> None:
    where = f"{path}, line {line}"
    if columns[0] != NAME:
        raise FiptError(f"{where}: the first column must be {NAME!r}; found {columns[0]!r}", "part columns by tabs")
    kinds = kinds_of(SceneEntry)
    members = kinds.members.values() if kinds is not None else ()
    allowed = list(dict.fromkeys(key for member in members for key in member.model_fields))
    for number, column in enumerate(columns[1:], 2):
        if column.split(".")[0] not in allowed:
            keys = f"columns: {NAME}, {', '.join(allowed)}; of sections with dots, as settings.fit.steps"
            raise FiptError(f"{where}, column {number}: there is no key {column!r} of a scene", keys)
        if columns.index(column) != number - 1:
            raise FiptError(f"{where}, column {number}: {column!r} is there again", "remove one of them")


def _entry(where: str, columns: tuple[str, ...], cells: list[str]) -> dict[str, Any]:
    """What a line says about its room."""
    entry: dict[str, Any] = {}
    for number, (column, cell) in enumerate(zip(columns[1:], cells[1:], strict=False), 2):
        if not cell.strip():
            continue
        place = f"{where}, column {number} ({column})"
        value: Any = _value(place, column, cell.strip())
        inner = next((other for other in columns if other.startswith(f"{column}.")), None)
        if inner is not None and not isinstance(value, dict):
            raise FiptError(
                f"{place}: {cell.strip()!r} is no section, but column {inner} is in it", "remove one of both"
            )
        for key in reversed(column.split(".")):
            value = {key: value}
        merge(entry, value)
    return entry


def _value(where: str, column: str, cell: str) -> Any:
    """The value of a cell: YAML in an inner section; else text, of which 2024 is a good name of a folder."""
    if "." not in column and cell not in _TRUTH and column not in ("setups", "settings"):
        return cell
    try:
        return parse_yaml(cell)
    except yaml.YAMLError as error:
        raise FiptError(f"{where}: {cell!r} is not YAML ({error})", "write it as in config.yaml") from error


def _mentions(message: str, name: str, column: str) -> bool:
    return any(
        f"{place}{column}{end}" in f"{message} "
        for place in (f"scenes.{name}.", f"scene {name}: ", f"scene {name}: settings.")
        for end in (" ", ":", ".", ",")
    )
