"""``fipt materials``: model and emitters -> material maps of a shard's views."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, EmittersFile, ManifestFile, ModelFile, SamplesFolder

if TYPE_CHECKING:
    from fipt.stages.render.settings import MaterialsSettings


@dataclass(frozen=True, kw_only=True)
class MaterialsInputs:
    """Files of ``fipt materials``."""

    dataset: DatasetFolder
    samples: SamplesFolder
    model: ModelFile
    emitters: EmittersFile
    out: Annotated[Path, "Folder of the maps."]
    manifest: ManifestFile
    confidence: Annotated[Path | None, "confidence.npz of the model; absent: the maps tell no confidence."] = None


def run(inputs: MaterialsInputs, settings: "MaterialsSettings") -> dict[str, Any]:
    """Write the material maps of every view of a shard, then their manifest."""
    from fipt.formats.exr import write_exr
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.model.store import load_model
    from fipt.progress import progress
    from fipt.scene.confidence import read_confidence
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import read_emitters
    from fipt.scene.samples import read_samples
    from fipt.settings import dumped
    from fipt.stages.render.maps import FittedSurface, material_maps

    data, shard = Dataset(inputs.dataset), read_samples(inputs.samples)
    confidence = None if inputs.confidence is None else read_confidence(inputs.confidence)
    surface = FittedSurface(load_model(inputs.model), read_emitters(inputs.emitters), data.mesh(), confidence)
    withdraw_manifest(inputs.manifest)
    files = []
    with progress("materials", shard.first_pixels[-1], " pixels") as bar:
        for index, view in enumerate(shard.views):
            camera = data.camera(view)
            files.append(inputs.out / f"{view}.exr")
            write_exr(files[-1], material_maps(surface, shard, index, camera, settings.average))
            bar.advance(camera.width * camera.height)
        rate = bar.rate
    write_manifest(inputs.manifest, "materials", files, dumped(settings))
    return {"pixels_per_s": rate}
