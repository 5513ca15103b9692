"""``fipt relight``: model, emitters and a light setup -> the views under other light."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    LampsFile,
    ManifestFile,
    ModelFile,
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
    setup: Annotated[str, typer.Option(help="Setup, JSON or YAML file: lights, objects, materials, what goes.")],
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")],
    manifest: ManifestFile,
    environment: EnvironmentFile = None,
    lamps: LampsFile = None,
    cameras: Annotated[
        list[str] | None,
        typer.Option(help="Of a setup with its own cameras: those to render, comma-separated; default: all."),
    ] = None,
    segments: Annotated[
        Path | None, typer.Option(help="fusion.npz, whose ids the setup names; default: connected parts of the mesh.")
    ] = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Render the views of the samples under another light setup; or what the setup's own cameras see.

    These trace their own samples, with the settings of --samples.
    """
    with stage("relight", settings, stats) as (chosen, figures):
        from fipt.errors import FiptError
        from fipt.scene.setup import parse_setup
        from fipt.stages.render.pictures import write_pictures

        light, names = parse_setup(setup), listed(cameras or [])
        if names and light.cameras is None:
            raise FiptError("--cameras needs a setup with cameras", "leave it out: the views of --samples are rendered")
        write_pictures(
            "relight", dataset, samples, cache, model, emitters, environment, light, out, manifest, chosen, figures,
            lamps=lamps, cameras=names, segments=segments,
        )  # fmt: skip
