"""``fipt refine``: samples, cache, model and emitters -> a shard's shading of the next round."""

import logging
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
    SettledFile,
    ShardFolder,
)

if TYPE_CHECKING:
    from fipt.scene.settled import ShadingChange
    from fipt.scene.shading import Shading
    from fipt.stages.shade.settings import RefineSettings

log = logging.getLogger(__name__)


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
    settled: SettledFile = None


def run(inputs: RefineInputs, settings: "RefineSettings") -> dict[str, Any]:
    """Path-trace the shading again with the fitted model.

    Where the loop of fit and refinement has settled, the shading of the round before is the result.
    """
    from fipt.formats.files import link_folder, manifest_beside
    from fipt.scene.settled import read_state
    from fipt.stages.shade.integrate import HOLDS, write_shading_manifest

    state = read_state(inputs.settled)
    if state is not None and state.settled is not None:
        manifest_beside(inputs.out).unlink(missing_ok=True)
        link_folder(inputs.previous, inputs.out, HOLDS)
        write_shading_manifest("refine", inputs.out, settings)
        log.info("settled in round %d: the shading of the round before stays", state.settled)
        return {"copied": True, "settled_in_round": state.settled}
    return _refined(inputs, settings, 1 if state is None else state.round + 1)


def _refined(inputs: RefineInputs, settings: "RefineSettings", number: int) -> dict[str, Any]:
    """Trace the shading of round ``number``, each with random numbers of its own, and join it with the one before."""
    from fipt.formats.files import manifest_beside
    from fipt.formats.manifests import manifest_stage
    from fipt.model.fitted import FittedScene
    from fipt.render.tracer import PathSettings
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import read_samples, view_pixels
    from fipt.scene.shading import read_shading
    from fipt.stages.shade.change import keep_share, light_is_missing
    from fipt.stages.shade.integrate import write_shading
    from fipt.stages.shade.refine import fitted_shader

    data, shard = Dataset(inputs.dataset), read_samples(inputs.samples)
    room = FittedScene.load(data.mesh(), inputs.model, inputs.emitters, inputs.environment, inputs.cache)
    path = PathSettings(settings.max_depth, settings.cache_roughness, settings.light_sampling)
    before = read_shading(inputs.previous, shard)
    # round 0 knew nothing of light that no view shows: neither its shading nor its materials are to be kept
    baked = manifest_stage(manifest_beside(inputs.previous)) == "bake"
    anew = baked and bool(room.emitters.guessed.any())
    shader, damping = fitted_shader(room, path, filled=anew), 0.0 if anew else settings.damping
    own = settings.model_copy(update={"seed": settings.seed + number})

    def joined(new: "Shading") -> "ShadingChange":
        emitting = room.emitters.triangle
        missing = not anew and light_is_missing(shard, new, before, view_pixels(data, [shard]), emitting)
        if missing:
            log.warning("the emitters that were found give too little light: the shading of the round before stays")
        return keep_share(shard, new, before, damping, whole=missing)

    return write_shading("refine", shader, data, shard, own, inputs.out, joined) | {"round": number}
