"""``fipt fit``: samples, shading, images and segments -> the model of a round."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    EnvironmentFile,
    SamplesFolders,
    SettingsJson,
    ShadingFolders,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    shading: ShadingFolders,
    out: Annotated[Path, typer.Option(help="File to write, model.safetensors.")],
    previous: Annotated[Path | None, typer.Option(help="Model of the round before.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Radiance cache; absent: unseen surface is left alone.")] = None,
    environment: EnvironmentFile = None,
    segments: Annotated[
        Path | None, typer.Option(help="Folder of fused segment ids; absent: those of the dataset.")
    ] = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Fit the BRDF and emission networks to the pictures.

    A fit that was interrupted goes on from its last checkpoint.
    """
    with stage("fit", settings, stats) as (chosen, figures):
        from fipt.stages.fit.run import fit_model

        fit_model(
            dataset, listed(samples), listed(shading), previous, cache, environment, segments, out, chosen, figures
        )
