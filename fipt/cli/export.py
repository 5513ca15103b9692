"""``fipt export``: model and emitters -> textures, glTF, Mitsuba, USD, Blender, cameras."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    BackgroundFile,
    DatasetFolder,
    EmittersFile,
    HitsFolders,
    LampsFile,
    ManifestFile,
    ModelFile,
    SettingsJson,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    hits: HitsFolders,
    model: ModelFile,
    emitters: EmittersFile,
    confidence: Annotated[Path, typer.Option(help="confidence.npz of the model.")],
    out: Annotated[Path, typer.Option(help="Folder of the exported room.")],
    manifest: ManifestFile,
    name: Annotated[str, typer.Option(help="Name of the room in the files.")] = "room",
    background: BackgroundFile = None,
    lamps: LampsFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Write the room for other programs: scene.glb, scene.usdc, mitsuba/, blender.py, textures/, cameras/."""
    with stage("export", settings, stats) as (chosen, figures):
        from fipt.export.stages import write_export
        from fipt.io.files import check_name

        check_name(name, "the room's name")
        shards = [Path(folder) for folder in listed(hits)]
        write_export(
            name, dataset, shards, model, emitters, lamps, confidence, background, out, manifest, chosen, figures
        )
