"""``fipt score``: what a method of a comparison reached, took and used, in one file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.compare.settings import CompareSettings


@dataclass(frozen=True, kw_only=True)
class ScoreInputs:
    """Files of ``fipt score``."""

    card: Annotated[str, "Card of the method with its id and seed, JSON (docs/stages/compare.md)."]
    metrics: Annotated[Path, "Its metrics.json."]
    jobs: Annotated[tuple[Path, ...], "Stats of the jobs that made its materials and emitters, comma-separated."]
    out: Annotated[Path, "method.json to write."]
    findings: Annotated[Path | None, "findings.json of the run, if its findings count."] = None


def run(inputs: ScoreInputs, settings: "CompareSettings") -> dict[str, Any]:
    """Write method.json of a run of a method. What the method does not estimate is null."""
    import json

    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.formats.text import MALFORMED, read_json
    from fipt.scene.findings import read_findings
    from fipt.stages.compare.score import parse_card, scored

    metrics = read_json(inputs.metrics, "the figures of a method", "run fipt metrics again")
    jobs = [read_json(path, "the figures of a job", "run its stage again") for path in inputs.jobs]
    card = parse_card(inputs.card)
    found = [] if inputs.findings is None else read_findings(inputs.findings)
    try:
        content = scored(card, metrics, jobs)
        if inputs.findings is not None:
            content["findings"] = [{"id": each.id, "cause": each.cause, "where": dict(each.where)} for each in found]
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    except MALFORMED as error:
        named = ", ".join(map(str, (inputs.metrics, *inputs.jobs)))
        raise FiptError(
            f"card, figures and stats of a method do not have their form ({error!r}); read were {named}",
            "run fipt metrics and the stages again",
        ) from error
    write_text(inputs.out, text + "\n")
    return {}
