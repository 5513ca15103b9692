"""``fipt compare-page``: write the HTML page that compares methods, on a scene or several."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.report.settings import ComparePageSettings


@dataclass(frozen=True, kw_only=True)
class ComparePageInputs:
    """Files of ``fipt compare-page``."""

    table: Annotated[Path, "table.json of the comparison."]
    out: Annotated[Path, "HTML file to write."]
    results: Annotated[
        Path | None,
        "Results folder of the scene; runs of methods lie in its folder methods. Absent: the table is of several.",
    ] = None


def run(inputs: ComparePageInputs, settings: "ComparePageSettings") -> dict[str, Any]:
    """Write one HTML page: who is first at what, the table, and a figure for every quantity, errors on one scale."""
    from jinja2 import UndefinedError

    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.formats.text import MALFORMED, read_json
    from fipt.stages.report.compared_rooms import build_rooms
    from fipt.stages.report.comparison import build_comparison

    table = read_json(inputs.table, "the table of the comparison", "run fipt compare again")
    try:
        if inputs.results is None:
            page = build_rooms(table)
        else:
            page = build_comparison(inputs.results, table, settings.views, settings.width)
    except (*MALFORMED, UndefinedError) as error:
        what = f"{inputs.table} is not the table of a comparison ({error!r})"
        raise FiptError(what, "run fipt compare again") from error
    write_text(inputs.out, page)
    return {"page_bytes": len(page.encode("utf-8"))}
