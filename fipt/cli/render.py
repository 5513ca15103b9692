"""``fipt render``: model and emitters -> the views, path traced."""

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
    SettingsJson,
    StatsFile,
    stage,
)


def command(
    dataset: DatasetFolder,
    hits: HitsFolder,
    cache: CacheFile,
    model: ModelFile,
    emitters: EmittersFile,
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    background: BackgroundFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Re-render the held-out views with the model."""
    with stage("render", settings, stats) as (chosen, figures):
        from fipt.relight.stages import write_pictures

        write_pictures(
            "render", dataset, hits, cache, model, emitters, background, None, out, manifest, chosen, figures
        )
