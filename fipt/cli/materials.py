"""``fipt materials``: model and emitters -> material maps of a shard's views."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    EmittersFile,
    HitsFolder,
    ManifestFile,
    ModelFile,
    SettingsJson,
    StatsFile,
    stage,
)


def command(
    dataset: DatasetFolder,
    hits: HitsFolder,
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
        from fipt.relight.stages import write_materials

        write_materials(dataset, hits, model, emitters, confidence, out, manifest, chosen, figures)
