"""The table of a capture, which says what EXIF does not: the files of each view, exposures."""

import csv
from dataclasses import replace
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import check_distinct, check_name, existing_file
from fipt.formats.text import read_text
from fipt.stages.capture.raw import MERGED_SUFFIXES, RAW_SUFFIXES, USUAL, Shot, read_shot

TABLE = "captures.tsv"
"""Table of a capture folder that overrides EXIF."""

_COLUMNS = ("view", "file", "shutter", "aperture", "iso")


def read_table(table: Path) -> tuple[str, dict[str, tuple[Shot, ...]]]:
    """Kind and views of a capture with a table.

    Raises
    ------
    FiptError
        If the table is damaged, or lists what cannot be a view.
    """
    lines_of = read_text(table, "the table of a capture").splitlines()
    reader = csv.DictReader(lines_of, delimiter="\t", quoting=csv.QUOTE_NONE)
    try:
        columns, rows = reader.fieldnames or [], list(reader)
    except csv.Error as error:
        raise FiptError(f"{table} is not a table ({error})", "separate its columns by tabs") from error
    if not {"view", "file"} <= set(columns) <= set(_COLUMNS) or len(set(columns)) < len(columns):
        raise FiptError(
            f"{table} must have the columns view and file, and may have shutter, aperture, iso; "
            f"found {', '.join(map(str, columns)) or 'nothing'}",
            "separate the columns by tabs and name them in the first line",
        )
    views: dict[str, tuple[Shot, ...]] = {}
    kinds = set()
    lines: dict[Path, int] = {}
    for number, row in enumerate(rows, start=2):
        where = f"{table}, line {number}"
        if None in row:  # where DictReader puts cells without a column
            raise FiptError(f"{where}: there are more cells than columns", "part cells by one tab each")
        path = existing_file(table.parent / (row["file"] or ""), f"a photograph ({where})")
        if lines.setdefault(path.resolve(), number) != number:
            raise FiptError(
                f"{where}: a photograph belongs to one view, once; {path.name} is that of line {lines[path.resolve()]}",
                "remove one of the lines",
            )
        view = check_name(row["view"] or "", f"{where}: view")
        given = {key: _positive(row.get(key), f"{where}: {key}", *USUAL[key]) for key in ("shutter", "aperture", "iso")}
        given = {key: value for key, value in given.items() if value is not None}
        suffix = path.suffix.lower()
        kind = "raw" if suffix in RAW_SUFFIXES else "merged" if suffix in MERGED_SUFFIXES else "ldr"
        kinds.add(kind)
        shot = Shot(path) if kind == "merged" else _read_tabled(path, "shutter" in given)
        shot = replace(shot, **given)
        if not shot.shutter and kind != "merged":
            raise FiptError(f"{path} states no exposure time", f"give it in column shutter of {where}")
        views[view] = (*views.get(view, ()), shot)
    if not rows or len(kinds) > 1:
        found = " and ".join(sorted(kinds)) or "no file"
        raise FiptError(f"{table} must list files of one kind (raw, ldr or merged); found {found}", "correct the table")
    check_distinct(views, f"{table}, views")
    return kinds.pop(), views


def _read_tabled(path: Path, has_shutter: bool) -> Shot:
    """Metadata of a listed file; a missing exposure time is no error where the table gives it."""
    try:
        return read_shot(path)
    except FiptError:
        if not has_shutter:
            raise
        return Shot(path)


def _positive(text: str | None, where: str, low: float, high: float) -> float | None:
    if text is None or not text.strip():
        return None
    above, _, below = text.partition("/")
    try:
        value = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        value = 0.0
    if not value > 0:
        raise FiptError(f"{where} must be a positive number such as 0.5 or 1/60; found {text!r}", "correct the table")
    if not low <= value <= high:
        raise FiptError(f"{where} must lie between {low:g} and {high:g}; found {text!r}", "correct the table")
    return value
