"""``fipt compare``: what every method reached -> one table, for programs, people and spreadsheets."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import UNSPLIT

if TYPE_CHECKING:
    from fipt.stages.compare.settings import CompareSettings


@dataclass(frozen=True, kw_only=True)
class CompareInputs:
    """Files of ``fipt compare``."""

    methods: Annotated[tuple[Path, ...], "method.json of every run, in the order of the table, comma-separated."]
    out: Annotated[Path, "table.json to write; table.md and table.csv come beside it."]
    not_applicable: Annotated[
        tuple[str, ...], "METHOD=REASON: a method for which the scene lacks something; repeatable.", UNSPLIT
    ] = ()
    failed: Annotated[tuple[str, ...], "RUN=REASON: a run of a method that failed; repeatable.", UNSPLIT] = ()


def run(inputs: CompareInputs, settings: "CompareSettings") -> dict[str, Any]:
    """Compare methods. Runs of one method with several seeds are one row: their mean and spread.

    A difference below the spread of either method is not ranked.
    """
    import json

    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.formats.text import MALFORMED, read_json
    from fipt.stages.compare.table import comparison
    from fipt.stages.compare.written import as_csv, as_markdown

    runs = [read_json(path, "what a method reached", "run fipt score again") for path in inputs.methods]
    missing, failed = (
        {name: why for name, _, why in (text.partition("=") for text in said)}
        for said in (inputs.not_applicable, inputs.failed)
    )
    try:
        table = comparison(runs, missing, failed)
        written = {
            ".md": as_markdown(table),
            ".csv": as_csv(table),
            inputs.out.suffix: json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        }
    except MALFORMED as error:
        named = ", ".join(map(str, inputs.methods))
        raise FiptError(
            f"what methods reached does not have its form ({error!r}); read were {named}", "run fipt score again"
        ) from error
    for suffix, text in written.items():
        write_text(inputs.out.with_suffix(suffix), text)
    return {"methods": len(table["methods"])}
