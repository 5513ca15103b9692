"""``fipt olat``: model and emitters -> views with each lamp alone."""

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
    Names,
    SamplesFolder,
    SettingsJson,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolder,
    cache: CacheFile,
    model: ModelFile,
    emitters: EmittersFile,
    views: Names,
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    environment: EnvironmentFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Render views with each lamp, and the light from outside, alone: their sum is the room as it is lit."""
    with stage("olat", settings, stats) as (chosen, figures):
        from fipt.stages.render.pictures import write_lamps

        write_lamps(
            dataset, samples, cache, model, emitters, environment, listed(views), out, manifest, chosen, figures
        )
