"""``fipt cache``: samples and images of the training views -> cache.npz."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, SamplesFolders, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    out: Annotated[Path, typer.Option(help="File to write, cache.npz.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Gather the pictures' radiance in voxels on the surface."""
    with stage("cache", settings, stats, backend=False) as (chosen, figures):
        from fipt.scene.dataset import Dataset
        from fipt.scene.samples import read_samples, view_pixels
        from fipt.scene.voxels import write_cache
        from fipt.stages.cache.build import build

        data = Dataset(dataset)
        shards = [read_samples(folder) for folder in listed(samples)]
        cache = build(data.mesh(), shards, view_pixels(data, shards), chosen)
        write_cache(out, cache)
        figures["voxels"] = len(cache["key"])
        figures["seen_voxels"] = int((cache["count"] > 0).sum())
        print(f"cache: {figures.figures['seen_voxels']} of {len(cache['key'])} surface voxels are seen")
