"""``fipt cache``: hits and images of the training views -> cache.npz."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, HitsFolders, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    hits: HitsFolders,
    out: Annotated[Path, typer.Option(help="File to write, cache.npz.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Gather the pictures' radiance in voxels on the surface."""
    with stage("cache", settings, stats, backend=False) as (chosen, figures):
        from fipt.io.dataset import Dataset
        from fipt.io.hits import clipped_of, pixels_of, read_hits
        from fipt.io.voxels import write_cache
        from fipt.shading.cache import build

        data = Dataset(dataset)
        shards = [read_hits(folder) for folder in listed(hits)]
        images, weights = zip(*(pixels_of(data, shard) for shard in shards), strict=True)
        clipped = [clipped_of(data, shard) for shard in shards]
        cache = build(data.mesh(), shards, list(images), list(weights), chosen, clipped)
        write_cache(out, cache)
        figures["voxels"] = len(cache["key"])
        figures["seen_voxels"] = int((cache["count"] > 0).sum())
        print(f"cache: {figures.figures['seen_voxels']} of {len(cache['key'])} surface voxels are seen")
