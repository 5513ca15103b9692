"""``fipt irradiance``: images and their irradiance -> one albedo for each part, emitters by a threshold."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, EmittersOut, SamplesFolders, ShadingFolders

if TYPE_CHECKING:
    from fipt.stages.irradiance.settings import IrradianceSettings


@dataclass(frozen=True, kw_only=True)
class IrradianceInputs:
    """Files of ``fipt irradiance``; samples and shading are those of the training shards, in the same order."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    out: Annotated[Path, "Materials of the parts to write, model.safetensors."]
    emitters_out: EmittersOut
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None


def run(inputs: IrradianceInputs, settings: "IrradianceSettings") -> dict[str, Any]:
    """Divide radiance by irradiance: a baseline for comparisons, with no fit."""
    from fipt.model.parts import part_labels, part_segments
    from fipt.model.store import save_parts
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import write_emitters
    from fipt.scene.observed import read_observed
    from fipt.stages.irradiance.estimate import albedo_of_parts, threshold_emitters

    data = Dataset(inputs.dataset, inputs.segments)
    mesh, shards = data.mesh(), read_observed(data, inputs.samples, inputs.shading)
    labels = part_labels(data, [shard.samples for shard in shards], part_segments(data))
    emitters = threshold_emitters(mesh, shards, settings.threshold)
    write_emitters(inputs.emitters_out, emitters, mesh, data.radiance_scale)
    save_parts(inputs.out, albedo_of_parts(labels, shards, emitters))
    return {"emitting_triangles": len(emitters.triangle)}
