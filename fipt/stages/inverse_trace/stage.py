"""``fipt inverse-trace``: images -> one material and one radiance for each part, by gradients of path tracing."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, EmittersOut, SamplesFolders

if TYPE_CHECKING:
    from fipt.stages.inverse_trace.settings import InverseTraceSettings


@dataclass(frozen=True, kw_only=True)
class InverseTraceInputs:
    """Files of ``fipt inverse-trace``; samples of the training shards."""

    dataset: DatasetFolder
    samples: SamplesFolders
    out: Annotated[Path, "Materials of the parts to write, model.safetensors."]
    emitters_out: EmittersOut
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None


def run(inputs: InverseTraceInputs, settings: "InverseTraceSettings") -> dict[str, Any]:
    """Optimise one material and one radiance a part through the path tracer: a method for comparisons."""
    from fipt.model.parts import part_labels, part_segments
    from fipt.model.store import save_parts
    from fipt.render.replay import ReplayScene
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import write_emitters
    from fipt.scene.samples import pixels_of, read_samples
    from fipt.stages.inverse_trace.optimise import optimise
    from fipt.stages.inverse_trace.parts import PartGroups, facing_viewers, seen_radiance
    from fipt.stages.inverse_trace.rays import training_pixels

    data = Dataset(inputs.dataset, inputs.segments)
    mesh, shards = data.mesh(), [read_samples(folder) for folder in inputs.samples]
    labels = part_labels(data, shards, part_segments(data))
    groups, pixels = PartGroups.of(labels), training_pixels(data, shards)
    seen = seen_radiance(groups, shards, [pixels_of(data, shard)[0] for shard in shards])
    scene = ReplayScene(facing_viewers(mesh, shards), groups.of_triangle, settings.max_depth)
    found = optimise(scene, pixels, seen, settings)
    values = found.values()
    emitters = groups.emitters(mesh, found.emits, values["emission"])
    write_emitters(inputs.emitters_out, emitters, mesh, data.radiance_scale)
    save_parts(inputs.out, groups.materials(labels, values))
    return {"parts": scene.count, "emitting_parts": int(found.emits.sum())}
