"""``fipt bake``: samples and cache of a shard -> its shading of round 0."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import CacheFile, DatasetFolder, EnvironmentFile, SamplesFolder, SettingsJson, StatsFile, stage


def command(
    dataset: DatasetFolder,
    samples: SamplesFolder,
    cache: CacheFile,
    out: Annotated[Path, typer.Option(help="Folder of the shard to write.")],
    environment: EnvironmentFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Integrate the shading of every pixel from the radiance cache."""
    with stage("bake", settings, stats) as (chosen, figures):
        from fipt.scene.dataset import Dataset
        from fipt.scene.environment import read_environment
        from fipt.scene.samples import read_samples
        from fipt.scene.voxels import read_cache
        from fipt.stages.shade.bake import cache_shader
        from fipt.stages.shade.integrate import write_shading

        data = Dataset(dataset)
        shader = cache_shader(data.mesh(), read_cache(cache), chosen.fill, read_environment(environment))
        write_shading("bake", shader, data, read_samples(samples), chosen, out, figures)
