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
    """Optimise materials of parts or texels, and radiance of parts, through the path tracer: for comparisons."""
    from functools import partial

    from fipt.model.parts import part_labels, part_segments
    from fipt.model.store import save_parts
    from fipt.render.replay import ReplayScene
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import write_emitters
    from fipt.scene.samples import pixels_of, read_samples
    from fipt.stages.inverse_trace.optimise import optimise
    from fipt.stages.inverse_trace.parts import PartGroups, facing_viewers, seen_radiance
    from fipt.stages.inverse_trace.rays import training_pixels
    from fipt.stages.inverse_trace.texels import SurfaceTexels, TextureOptimiser

    data = Dataset(inputs.dataset, inputs.segments)
    mesh, shards = data.mesh(), [read_samples(folder) for folder in inputs.samples]
    labels = part_labels(data, shards, part_segments(data))
    groups, pixels = PartGroups.of(labels), training_pixels(data, shards)
    seen = seen_radiance(groups, shards, [pixels_of(data, shard)[0] for shard in shards])
    room = facing_viewers(mesh, shards)
    if settings.texels:
        texels = SurfaceTexels.of(room, groups.of_triangle, settings.texels)
        scene = ReplayScene(room, groups.of_triangle, settings.max_depth, texels.rows)
        textured = partial(TextureOptimiser, texels, smoothness=settings.smoothness)
        found = optimise(scene, pixels, seen, settings, textured)
        materials = texels.materials(len(mesh.triangles), found.values())
    else:
        scene = ReplayScene(room, groups.of_triangle, settings.max_depth)
        found = optimise(scene, pixels, seen, settings)
        materials = groups.materials(labels, found.values())
    values = found.values()
    emitters = groups.emitters(mesh, found.emits, values["emission"])
    write_emitters(inputs.emitters_out, emitters, mesh, data.radiance_scale)
    save_parts(inputs.out, materials)
    return {"parts": scene.count, "rows": scene.rows, "emitting_parts": int(found.emits.sum())}
