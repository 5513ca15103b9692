"""``fipt compare-rooms``: the tables of several scenes -> one, with the mean over them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.compare.settings import CompareSettings


@dataclass(frozen=True, kw_only=True)
class CompareRoomsInputs:
    """Files of ``fipt compare-rooms``."""

    tables: Annotated[tuple[Path, ...], "table.json of every scene, comma-separated."]
    rooms: Annotated[tuple[str, ...], "Names of the scenes, in the same order, comma-separated."]
    out: Annotated[Path, "table.json to write; table.md and table.csv come beside it."]


def run(inputs: CompareRoomsInputs, settings: "CompareSettings") -> dict[str, Any]:
    """Compare methods on several scenes: the table of each, and the mean over them.

    A method that lacks a figure in one scene has no mean of it.
    """
    import json

    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.formats.text import read_json
    from fipt.stages.compare.rooms import across_rooms
    from fipt.stages.compare.written import rooms_as_csv, rooms_as_markdown

    if len(inputs.tables) != len(inputs.rooms):
        raise FiptError(
            f"--rooms must name a scene for each table; found {len(inputs.rooms)} for {len(inputs.tables)}",
            "name them in the order of --tables",
        )
    tables = [read_json(path, "the table of a comparison", "run fipt compare again") for path in inputs.tables]
    found = across_rooms(dict(zip(inputs.rooms, tables, strict=True)))
    write_text(inputs.out.with_suffix(".md"), rooms_as_markdown(found))
    write_text(inputs.out.with_suffix(".csv"), rooms_as_csv(found))
    write_text(inputs.out, json.dumps(found, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    return {"rooms": len(tables), "methods": len(found["mean"]["methods"])}
