"""``fipt background``: hits and images of the training views -> background.npz."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, HitsFolders, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    hits: HitsFolders,
    out: Annotated[Path, typer.Option(help="File to write, background.npz.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Find the radiance of rays that leave the mesh: stated, given, or seen by pixels without surface."""
    with stage("background", settings, stats, backend=False) as (chosen, figures):
        from fipt.background.fit import find_background
        from fipt.io.background import write_background
        from fipt.io.dataset import Dataset
        from fipt.io.hits import read_hits
        from fipt.settings import check_background

        check_background(chosen)
        shards = [read_hits(folder) for folder in listed(hits)]
        found = find_background(Dataset(dataset), shards, chosen, figures)
        write_background(out, found)
        mean = found.mean
        figures["mode"], figures["mean"] = found.mode, mean.tolist()
        print(f"background: {found.mode}, mean radiance {mean[0]:.4g} {mean[1]:.4g} {mean[2]:.4g}")
