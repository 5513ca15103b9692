"""``fipt report``: write the HTML page that shows everything."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.registry import parse
from fipt.settings import dumped


def command(
    results: Annotated[Path, typer.Option(help="results folder of the scene")],
    out: Annotated[Path, typer.Option(help="HTML file to write")],
    setups: Annotated[
        str | None,
        typer.Option(help="light setups whose views are shown, comma-separated; default: all that the folder holds"),
    ] = None,
    films: Annotated[
        str | None, typer.Option(help="light setups with cameras of their own that are shown; default: likewise")
    ] = None,
    settings: Annotated[str, typer.Option(help="JSON of the config section `report`")] = "{}",
    stats: Annotated[Path | None, typer.Option(help="file for times and memory")] = None,
) -> None:
    """Write one HTML page with all pictures in it; it loads nothing else.

    Shows whatever the folder holds: files that do not exist yet are left out.
    """
    from fipt.cli.options import listed
    from fipt.formats.files import write_text
    from fipt.formats.manifests import recorded
    from fipt.stages.report.page import build_page

    options = parse("report", settings)
    with recorded(stats, "report", dumped(options)) as figures:
        chosen = (None if names is None else listed([names]) for names in (setups, films))
        page = build_page(results, options, *chosen)
        write_text(out, page)
        figures["page_bytes"] = len(page.encode("utf-8"))
