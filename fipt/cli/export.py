"""``fipt export``: model and emitters -> textures, glTF, Mitsuba, USD, Blender, cameras."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    LampsFile,
    ManifestFile,
    ModelFile,
    SamplesFolders,
    SettingsJson,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    model: ModelFile,
    emitters: EmittersFile,
    confidence: Annotated[Path, typer.Option(help="confidence.npz of the model.")],
    out: Annotated[Path, typer.Option(help="Folder of the exported room.")],
    manifest: ManifestFile,
    name: Annotated[str, typer.Option(help="Name of the room in the files.")] = "room",
    environment: EnvironmentFile = None,
    lamps: LampsFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Write the room for other programs: scene.glb, scene.usdc, mitsuba/, blender.py, textures/, cameras/."""
    with stage("export", settings, stats) as (chosen, figures):
        from fipt.formats.files import check_name
        from fipt.stages.export.write import write_export

        check_name(name, "the room's name")
        shards = [Path(folder) for folder in listed(samples)]
        write_export(
            name, dataset, shards, model, emitters, lamps, confidence, environment, out, manifest, chosen, figures
        )
