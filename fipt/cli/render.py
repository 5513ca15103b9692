"""``fipt render``: model and emitters -> the views, path traced."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
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
    cache: CacheFile,
    model: ModelFile,
    emitters: EmittersFile,
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    environment: EnvironmentFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Re-render the held-out views with the model."""
    with stage("render", settings, stats) as (chosen, figures):
        from fipt.stages.render.pictures import write_pictures

        write_pictures(
            "render", dataset, samples, cache, model, emitters, environment, None, out, manifest, chosen, figures
        )
