"""``fipt bake``: samples and cache of a shard -> its shading of round 0."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import CacheFile, DatasetFolder, EnvironmentFile, SamplesFolder, ShardFolder

if TYPE_CHECKING:
    from fipt.stages.shade.settings import BakeSettings


@dataclass(frozen=True, kw_only=True)
class BakeInputs:
    """Files of ``fipt bake``."""

    dataset: DatasetFolder
    samples: SamplesFolder
    cache: CacheFile
    out: ShardFolder
    environment: EnvironmentFile = None
    true_samples: Annotated[tuple[Path, ...], "With bake.truth: samples of all training shards, comma-separated."] = ()


def run(inputs: BakeInputs, settings: "BakeSettings") -> dict[str, Any]:
    """Integrate the shading of every pixel from the radiance cache; or, as a bound, in the true room."""
    from fipt.scene.dataset import Dataset
    from fipt.scene.environment import read_environment
    from fipt.scene.samples import read_samples
    from fipt.scene.voxels import read_cache
    from fipt.stages.shade.bake import cache_shader
    from fipt.stages.shade.integrate import write_shading

    data = Dataset(inputs.dataset)
    cache, outside = read_cache(inputs.cache), read_environment(inputs.environment)
    if settings.truth:
        from fipt.stages.shade.true_room import true_shader

        shader = true_shader(data, [read_samples(path) for path in inputs.true_samples], cache, outside)
    else:
        shader = cache_shader(data.mesh(), cache, settings.fill, outside)
    return write_shading("bake", shader, data, read_samples(inputs.samples), settings, inputs.out)
