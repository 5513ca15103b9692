"""``fipt samples``: cameras and mesh -> footprint samples of a shard."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, Names, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    views: Names,
    out: Annotated[Path, typer.Option(help="Folder of the shard to write.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Trace the footprint samples of every pixel, once."""
    with stage("samples", settings, stats) as (chosen, figures):
        from fipt.scene.dataset import Dataset
        from fipt.stages.samples.trace import write_shard

        write_shard(Dataset(dataset), listed(views), out, chosen, figures)
