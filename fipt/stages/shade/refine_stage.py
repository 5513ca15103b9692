"""``fipt refine``: samples, cache, model and emitters -> a shard's shading of the next round."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    ModelFile,
    SamplesFolder,
    ShardFolder,
)

if TYPE_CHECKING:
    import numpy as np

    from fipt.stages.shade.settings import RefineSettings


@dataclass(frozen=True, kw_only=True)
class RefineInputs:
    """Files of ``fipt refine``."""

    dataset: DatasetFolder
    samples: SamplesFolder
    cache: CacheFile
    model: ModelFile
    emitters: EmittersFile
    previous: Annotated[Path, "Shading of this shard of the round before."]
    out: ShardFolder
    environment: EnvironmentFile = None


def run(inputs: RefineInputs, settings: "RefineSettings") -> dict[str, Any]:
    """Path-trace the shading again with the fitted model."""
    from fipt.formats.manifests import manifest_stage
    from fipt.model.fitted import FittedScene
    from fipt.render.tracer import PathSettings
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import read_samples
    from fipt.scene.shading import read_shading
    from fipt.stages.shade.integrate import write_shading
    from fipt.stages.shade.refine import damped, fitted_shader

    data, shard = Dataset(inputs.dataset), read_samples(inputs.samples)
    room = FittedScene.load(data.mesh(), inputs.model, inputs.emitters, inputs.environment, inputs.cache)
    path = PathSettings(settings.max_depth, settings.cache_roughness, settings.light_sampling)
    before = read_shading(inputs.previous, shard)
    # round 0 knew nothing of light that no view shows: neither its shading nor its materials are to be kept
    baked = manifest_stage(inputs.previous.with_name(f"{inputs.previous.name}.manifest.json")) == "bake"
    anew = baked and bool(room.emitters.guessed.any())
    shader, damping = fitted_shader(room, path, filled=anew), 0.0 if anew else settings.damping

    def kept(index: int, new: "np.ndarray") -> "np.ndarray":
        return damped(new, before[shard.of_view(index)], damping)

    return write_shading("refine", shader, data, shard, settings, inputs.out, kept)
