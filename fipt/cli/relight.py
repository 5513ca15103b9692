"""``fipt relight``: model, emitters and a light setup -> the views under other light."""

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
    setup: Annotated[str, typer.Option(help="Setup, JSON or YAML file: lights, objects, materials, what goes.")],
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    background: BackgroundFile = None,
    segments: Annotated[
        Path | None, typer.Option(help="fusion.npz, whose ids the setup names; default: connected parts of the mesh.")
    ] = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Render the views under another light setup."""
    with stage("relight", settings, stats) as (chosen, figures):
        from fipt.relight.stages import write_pictures
        from fipt.settings import parse_setup

        light = parse_setup(setup)
        inputs = (dataset, hits, cache, model, emitters, background)
        write_pictures("relight", *inputs, light, out, manifest, chosen, figures, segments)
