"""``fipt materials``: model and emitters -> material maps of a shard's views."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    EmittersFile,
    ManifestFile,
    ModelFile,
    SamplesFolder,
    SettingsJson,
    StatsFile,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolder,
    model: ModelFile,
    emitters: EmittersFile,
    confidence: Annotated[Path, typer.Option(help="confidence.npz of the model.")],
    out: Annotated[Path, typer.Option(help="Folder of the maps.")],
    manifest: ManifestFile,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Write the material maps of every view."""
    with stage("materials", settings, stats) as (chosen, figures):
        from fipt.stages.render.pictures import write_materials

        write_materials(dataset, samples, model, emitters, confidence, out, manifest, chosen, figures)
