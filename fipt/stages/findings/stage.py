"""``fipt findings``: what is wrong with a run, why, and what to do."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    ModelFile,
    SamplesFolders,
    ShadingFolders,
)

if TYPE_CHECKING:
    from fipt.stages.findings.room import JudgedRoom
    from fipt.stages.findings.settings import FindingsSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class FindingsInputs:
    """Files of ``fipt findings``; shading, model and emitters are those of the last round."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    model: ModelFile
    emitters: EmittersFile
    cache: CacheFile
    out: Annotated[Path, "File to write, findings.json; the pictures come into the folder findings beside it."]
    environment: EnvironmentFile = None
    held_out: Annotated[tuple[Path, ...], "Samples shards of the held-out views; without them none are judged."] = ()
    earlier: Annotated[tuple[Path, ...], "Shading of the round before, as --shading; without it, one round ran."] = ()
    settled: Annotated[tuple[Path, ...], "settled.json of the last rounds, in their order."] = ()
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None
    confidence: Annotated[Path | None, "confidence.npz of the model; absent: predicted errors are not judged."] = None


def run(inputs: FindingsInputs, settings: "FindingsSettings") -> dict[str, Any]:
    """Look for what went wrong, and write findings with their causes, numbers, pictures and remedies.

    Findings are no failure: the exit code is 0 whatever is found.
    """
    from fipt.formats.files import atomic_folder
    from fipt.formats.images import write_png
    from fipt.scene.findings import write_findings
    from fipt.stages.findings.judge import judged

    found, notes = judged(_room(inputs, settings))
    with atomic_folder(inputs.out.parent / "findings", r"[\w.-]+\.png") as folder:
        for finding in found:
            if finding.image is not None:
                write_png(folder / f"{finding.id}.png", finding.image)
    write_findings(inputs.out, found, notes.measures)
    for finding in found:
        log.warning("%s %s", finding.cause, finding.remedy)
    return {"findings": {finding.id: finding.severity for finding in found}}


def _room(inputs: FindingsInputs, settings: "FindingsSettings") -> "JudgedRoom":
    from fipt.formats.arrays import on_disk
    from fipt.model.fitted import FittedScene
    from fipt.scene.change import read_round
    from fipt.scene.confidence import read_confidence
    from fipt.scene.dataset import Dataset
    from fipt.scene.observed import check_as_many, read_observed
    from fipt.scene.samples import read_samples
    from fipt.scene.settled import read_state
    from fipt.stages.findings.room import JudgedRoom

    data = Dataset(inputs.dataset, inputs.segments)
    empty = on_disk(inputs.out.parent)
    shards = read_observed(data, inputs.samples, inputs.shading, empty)
    if inputs.earlier:
        check_as_many("--earlier", inputs.earlier, inputs.samples)
    return JudgedRoom(
        data,
        FittedScene.load(data.mesh(), inputs.model, inputs.emitters, inputs.environment, inputs.cache),
        shards,
        [read_samples(path) for path in inputs.held_out],
        read_round(inputs.earlier, [shard.samples for shard in shards], empty) if inputs.earlier else None,
        settings,
        _prepared(inputs.dataset / "prepare.json"),
        [state for state in map(read_state, inputs.settled) if state is not None],
        None if inputs.confidence is None else read_confidence(inputs.confidence),
    )


def _prepared(path: Path) -> dict[str, Any]:
    """Figures of the mesh's preparation; none where nothing was prepared."""
    import json

    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
