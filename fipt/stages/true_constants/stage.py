"""``fipt true-constants``: ground truth -> its mean material for each part, and the true emitters."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, EmittersOut, SamplesFolders

if TYPE_CHECKING:
    from fipt.stages.true_constants.settings import TrueConstantsSettings


@dataclass(frozen=True, kw_only=True)
class TrueConstantsInputs:
    """Files of ``fipt true-constants``; samples of the training shards."""

    dataset: DatasetFolder
    samples: SamplesFolders
    out: Annotated[Path, "Materials of the parts to write, model.safetensors."]
    emitters_out: EmittersOut
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None


def run(inputs: TrueConstantsInputs, settings: "TrueConstantsSettings") -> dict[str, Any]:
    """Average the true materials of every part: a bound for comparisons, which no method can know."""
    from fipt.model.parts import part_labels, part_segments
    from fipt.model.store import save_parts
    from fipt.model.truth import mean_materials, true_emitters, true_pixels
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import write_emitters
    from fipt.scene.samples import read_samples

    data = Dataset(inputs.dataset, inputs.segments)
    mesh, shards = data.mesh(), [read_samples(folder) for folder in inputs.samples]
    labels, pixels = part_labels(data, shards, part_segments(data)), true_pixels(data, shards)
    emitters = true_emitters(mesh, pixels)
    write_emitters(inputs.emitters_out, emitters, mesh, data.radiance_scale)
    save_parts(inputs.out, mean_materials(labels, pixels))
    return {"parts": int(labels.of_triangle.max(initial=0)), "emitting_triangles": len(emitters.triangle)}
