"""``fipt environment``: samples and images of the training views -> environment.npz."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, SamplesFolders, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    out: Annotated[Path, typer.Option(help="File to write, environment.npz.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Find the radiance of rays that leave the mesh: stated, given, or seen by pixels without surface."""
    with stage("environment", settings, stats, backend=False) as (chosen, figures):
        from fipt.scene.dataset import Dataset
        from fipt.scene.environment import write_environment
        from fipt.scene.samples import read_samples
        from fipt.stages.environment.fit import find_environment

        shards = [read_samples(folder) for folder in listed(samples)]
        found = find_environment(Dataset(dataset), shards, chosen, figures)
        write_environment(out, found)
        mean = found.mean
        figures["mode"], figures["mean"] = found.mode, mean.tolist()
        print(f"background: {found.mode}, mean radiance {mean[0]:.4g} {mean[1]:.4g} {mean[2]:.4g}")
