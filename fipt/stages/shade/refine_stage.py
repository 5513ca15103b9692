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
    from fipt.model.fitted import FittedScene
    from fipt.scene.change import ShadingDifferences
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import FootprintSamples
    from fipt.scene.settled import RoundState
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
    """Path-trace the shading again with the fitted model, and say by what it differs from that of the round before.

    Where the loop of fit and refinement has settled, the shading of the round before is the result.
    """
    from fipt.formats.files import link_folder, manifest_beside
    from fipt.formats.manifests import withdraw_manifest
    from fipt.scene.settled import read_state
    from fipt.stages.shade.integrate import HOLDS, write_shading_manifest

    state = read_state(inputs.settled)
    if state is not None and state.settled is not None:
        withdraw_manifest(manifest_beside(inputs.out))
        link_folder(inputs.previous, inputs.out, HOLDS)
        write_shading_manifest("refine", inputs.out, settings)
        log.info("settled in round %d: the shading of the round before stays", state.settled)
        return {"copied": True, "settled_in_round": state.settled}
    return _refined(inputs, settings, state)


def _refined(inputs: RefineInputs, settings: "RefineSettings", state: "RoundState | None") -> dict[str, Any]:
    """Trace the shading of the round after ``state``, each with random numbers of its own; keep the one before it."""
    from fipt.formats.arrays import on_disk
    from fipt.formats.files import manifest_beside
    from fipt.formats.manifests import manifest_stage
    from fipt.model.fitted import FittedScene
    from fipt.render.tracer import PathSettings
    from fipt.scene.change import joined_shading, write_differences
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import read_samples
    from fipt.scene.shading import BEFORE, save_shading
    from fipt.stages.shade.integrate import write_shading
    from fipt.stages.shade.refine import fitted_shader

    data, shard = Dataset(inputs.dataset), read_samples(inputs.samples)
    room = FittedScene.load(data.mesh(), inputs.model, inputs.emitters, inputs.environment, inputs.cache)
    path = PathSettings(settings.max_depth, settings.cache_roughness, settings.light_sampling)
    kept = 0.0 if state is None else state.kept
    before = joined_shading(inputs.previous, shard, kept, on_disk(inputs.out.parent))
    # the shading before knew nothing of light that no view shows: neither it nor its materials are to be kept
    baked = manifest_stage(manifest_beside(inputs.previous)) == "bake"
    lacked = state is not None and state.light_missing > 0 and state.moved > 0
    anew = (baked or lacked) and bool(room.emitters.guessed.any())
    shader, damping = fitted_shader(room, path, filled=anew), 0.0 if anew else settings.damping
    number = 1 if state is None else state.round + 1
    own = settings.model_copy(update={"seed": settings.seed + number})

    def compare(new: "Shading", folder: Path) -> None:
        save_shading(folder, before, BEFORE)
        write_differences(folder, _differences(data, shard, room, (new, before), not anew), damping)

    return write_shading("refine", shader, data, shard, own, inputs.out, compare) | {"round": number}


def _differences(
    data: "Dataset",
    samples: "FootprintSamples",
    room: "FittedScene",
    shading: "tuple[Shading, Shading]",
    photographed: bool,
) -> "ShadingDifferences":
    """What the shading of this round and that before differ by, view by view.

    Parameters
    ----------
    photographed
        Whether photographs are asked if light is missing.
    """
    from fipt.scene.change import ShadingDifferences, view_differences
    from fipt.scene.samples import view_pixels
    from fipt.scene.shading import diffuse_shading
    from fipt.stages.shade.brighter import more_brighter

    box, emitting = (room.cache["center"], float(room.cache["side"])), room.emitters.triangle
    found = []
    for index, pixels in enumerate(view_pixels(data, [samples])):
        more = more_brighter(samples, index, shading, pixels, emitting) if photographed else (0.0, 0)
        now, before = (diffuse_shading(each, samples.of_view(index)).mean(axis=1) for each in shading)
        found.append(view_differences(samples, index, (now, before), box, more))
    return ShadingDifferences.joined(found)
