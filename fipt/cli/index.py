"""``fipt index``: one page and one table over all rooms."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    results: Annotated[Path, typer.Argument(help="Folder of all results.")] = Path("results"),
) -> None:
    """Write RESULTS/index.html and RESULTS/summary.tsv: every room with its state, figures, findings and times.

    The page sorts and filters, and loads nothing from anywhere. `fipt run` of several rooms writes it at its end.
    """
    from fipt.stages.report.index import INDEX, SUMMARY, write_index

    rooms = write_index(results)
    print(f"{results / INDEX} and {results / SUMMARY}: {rooms} rooms")
