"""``fipt lamps``: model and emitters -> views with each lamp alone."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    BackgroundFile,
    CacheFile,
    DatasetFolder,
    EmittersFile,
    HitsFolder,
    ManifestFile,
    ModelFile,
    Names,
    SettingsJson,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    hits: HitsFolder,
    cache: CacheFile,
    model: ModelFile,
    emitters: EmittersFile,
    views: Names,
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    background: BackgroundFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Render views with each lamp, and the light from outside, alone: their sum is the room as it is lit."""
    with stage("lamps", settings, stats) as (chosen, figures):
        from fipt.relight.stages import write_lamps

        write_lamps(dataset, hits, cache, model, emitters, background, listed(views), out, manifest, chosen, figures)
