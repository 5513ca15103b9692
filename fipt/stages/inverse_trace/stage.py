"""``fipt inverse-trace``: images -> materials, and one radiance for each part, by gradients of path tracing."""

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
    out: Annotated[Path, "Materials to write, model.safetensors."]
    emitters_out: EmittersOut
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None


def run(inputs: InverseTraceInputs, settings: "InverseTraceSettings") -> dict[str, Any]:
    """Optimise radiance of parts, and materials of parts, texels or networks, through the path tracer."""
    from functools import partial

    from fipt.errors import FiptError
    from fipt.model.networks import Field, SceneBox
    from fipt.model.parts import part_labels, part_segments
    from fipt.model.settings import NetworkSettings
    from fipt.model.store import save_field, save_parts
    from fipt.render.replay import ReplayScene
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import write_emitters
    from fipt.scene.samples import pixels_of, read_samples, scene_box
    from fipt.stages.inverse_trace.field import FieldOptimiser
    from fipt.stages.inverse_trace.optimise import optimise
    from fipt.stages.inverse_trace.parts import PartGroups, facing_viewers, seen_radiance
    from fipt.stages.inverse_trace.rays import training_pixels
    from fipt.stages.inverse_trace.texels import SurfaceTexels, TextureOptimiser

    if settings.field and not settings.texels:
        raise FiptError("inverse_trace.field needs texels, where the networks are asked; found 0", "set texels to 16")
    data = Dataset(inputs.dataset, inputs.segments)
    mesh, shards = data.mesh(), [read_samples(folder) for folder in inputs.samples]
    labels = part_labels(data, shards, part_segments(data))
    groups, pixels = PartGroups.of(labels), training_pixels(data, shards)
    seen = seen_radiance(groups, shards, [pixels_of(data, shard) for shard in shards])
    room, field = facing_viewers(mesh, shards), None
    if settings.field:
        center, side = scene_box(shards)
        box = SceneBox((center[0], center[1], center[2]), side)
        field = Field(NetworkSettings(seed=settings.seed, whitest=1), box, mask=False)
    texels = SurfaceTexels.of(room, groups.of_triangle, settings.texels) if settings.texels else None
    scene = ReplayScene(room, groups.of_triangle, settings.max_depth, None if texels is None else texels.rows)
    if field is not None and texels is not None:
        networks = partial(FieldOptimiser, field, texels.place, 1 / settings.texels)
        found = optimise(scene, pixels, seen, settings, networks)
        save_field(inputs.out, field, field.settings)
    elif texels is not None:
        textured = partial(TextureOptimiser, texels, smoothness=settings.smoothness)
        found = optimise(scene, pixels, seen, settings, textured)
        save_parts(inputs.out, texels.materials(len(mesh.triangles), found.values()))
    else:
        found = optimise(scene, pixels, seen, settings)
        save_parts(inputs.out, groups.materials(labels, found.values()))
    emitters = groups.emitters(mesh, found.emits, found.values()["emission"])
    write_emitters(inputs.emitters_out, emitters, mesh, data.radiance_scale)
    return {"parts": scene.count, "rows": scene.rows, "emitting_parts": int(found.emits.sum())}
