"""``fipt refine``: samples, cache, model and emitters -> a shard's shading of the next round."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    ModelFile,
    SamplesFolder,
    SettingsJson,
    StatsFile,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolder,
    cache: CacheFile,
    model: ModelFile,
    emitters: EmittersFile,
    previous: Annotated[Path, typer.Option(help="Shading of this shard of the round before.")],
    out: Annotated[Path, typer.Option(help="Folder of the shard to write.")],
    environment: EnvironmentFile = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Path-trace the shading again with the fitted model."""
    with stage("refine", settings, stats) as (chosen, figures):
        from fipt.model.fitted import voxel_materials
        from fipt.model.store import load_field
        from fipt.render.surface import emitter_set
        from fipt.render.tracer import PathSettings
        from fipt.scene.dataset import Dataset
        from fipt.scene.emitters import read_emitters
        from fipt.scene.environment import read_environment
        from fipt.scene.samples import read_samples
        from fipt.scene.shading import read_shading
        from fipt.scene.voxels import read_cache
        from fipt.stages.shade.integrate import write_shading
        from fipt.stages.shade.refine import damped, path_shader

        data, shard, voxels = Dataset(dataset), read_samples(samples), read_cache(cache)
        field = load_field(model)
        path = PathSettings(chosen.max_depth, chosen.cache_roughness, chosen.light_sampling)
        materials = voxel_materials(field, voxels)
        found, outside = emitter_set(read_emitters(emitters)), read_environment(environment)
        shader = path_shader(data.mesh(), voxels, materials, found, path, outside)
        before = read_shading(previous, shard)
        write_shading(
            "refine",
            shader,
            data,
            shard,
            chosen,
            out,
            figures,
            finish=lambda index, new: damped(new, before[shard.of_view(index)], chosen.damping),
        )
