"""``fipt bake``: hits and cache of a shard -> its shading of round 0."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import BackgroundFile, CacheFile, DatasetFolder, HitsFolder, SettingsJson, StatsFile, stage


def command(
    dataset: DatasetFolder,
    hits: HitsFolder,
    cache: CacheFile,
    out: Annotated[Path, typer.Option(help="Folder of the shard to write.")],
    background: BackgroundFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Integrate the shading of every pixel from the radiance cache."""
    with stage("bake", settings, stats) as (chosen, figures):
        from fipt.io.background import read_background
        from fipt.io.dataset import Dataset
        from fipt.io.hits import read_hits
        from fipt.io.voxels import read_cache
        from fipt.shading.bake import cache_shader
        from fipt.shading.integrate import write_shading

        data = Dataset(dataset)
        shader = cache_shader(data.mesh(), read_cache(cache), chosen.fill, read_background(background))
        write_shading("bake", shader, data, read_hits(hits), chosen, out, figures)
