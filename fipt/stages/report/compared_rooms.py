"""The page that compares methods on several scenes: the mean over them, and every scene."""

from collections.abc import Mapping
from typing import Any

from fipt.errors import FiptError
from fipt.stages.report.comparison import bars, winners
from fipt.stages.report.page import filled


def build_rooms(found: Mapping[str, Any]) -> str:
    """Return the page of a comparison over rooms; it links those of the rooms, beside its own folder.

    Raises
    ------
    FiptError
        If the table is that of one scene.
    """
    if "rooms" not in found:
        raise FiptError("--table must be that of several scenes without --results; found one scene", "give --results")
    tables = {"mean": found["mean"], **found["rooms"]}
    return filled(
        "compared_rooms.html",
        ("style.css", "comparison.css"),
        (),
        rooms=found["rooms"],
        mean=found["mean"],
        winners=winners(found["mean"]),
        bars={name: bars(table) for name, table in tables.items()},
        seeds=max((row["seeds"] for row in found["mean"]["methods"]), default=1),
    )
