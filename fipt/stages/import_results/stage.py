"""``fipt import-results``: what others estimated -> maps and pictures of a run of a method."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, ManifestFile

if TYPE_CHECKING:
    from fipt.stages.import_results.settings import ImportResultsSettings


@dataclass(frozen=True, kw_only=True)
class ImportResultsInputs:
    """Files of ``fipt import-results``."""

    dataset: DatasetFolder
    samples: Annotated[tuple[Path, ...], "Samples of the views whose materials are given, comma-separated."]
    scene: Annotated[str, "Name of the scene."]
    out: Annotated[Path, "Folder of the run; materials, render and relight/SETUP are written there."]
    manifest: ManifestFile
    reference: Annotated[
        str | None, "SETUP=FOLDER: photographs under the light of the setup; default: its truth counts."
    ] = None


def run(inputs: ImportResultsInputs, settings: "ImportResultsSettings") -> dict[str, Any]:
    """Bring what another program estimated to our layers; what it did not estimate stays unknown."""
    import logging

    from fipt.errors import FiptError
    from fipt.formats.exr import write_exr
    from fipt.formats.files import atomic_folder
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.scene.cameras import read_transforms
    from fipt.scene.dataset import Dataset
    from fipt.scene.references import find_references
    from fipt.scene.samples import read_samples
    from fipt.settings import dumped
    from fipt.stages.import_results.blank import check_not_blank
    from fipt.stages.import_results.files import found_results
    from fipt.stages.import_results.views import material_layers, shown_images

    data = Dataset(inputs.dataset)
    # rejected views keep their number: other programs knew nothing of our checks
    cameras = read_transforms(data.root / "transforms.json")
    train, held_out = ([each.name for each in cameras if each.split == split] for split in (settings.views, "val"))
    setup, _, photographs = (inputs.reference or "").partition("=")
    photographed = find_references(photographs, held_out) if photographs else None
    found = found_results(settings, inputs.scene, train, held_out, photographed, data.rejected)
    if settings.path is None:
        raise FiptError("import_results.path must name the folder of the other program's files", "give it")
    truth = data.root / "relight_truth" / settings.setup
    if settings.setup != setup and not truth.is_dir():
        raise FiptError(
            f"import_results.setup names {settings.setup}, of which {data.root} has no truth, and --reference no "
            "photographs",
            "correct the name",
        )
    if not found.files():
        raise FiptError(f"{settings.path} holds no outputs of this scene", "check path, method and scene of the card")
    shards = [read_samples(folder) for folder in inputs.samples]
    folders = {"materials": material_layers(data, shards, found, settings)}
    folders["render"] = shown_images(data, found, "viewsynthesis", None, settings.scaled)
    if settings.setup:
        folders[f"relight/{settings.setup}"] = shown_images(data, found, "relight", truth, settings.scaled)
    warnings = check_not_blank(folders)
    for warning in warnings:
        logging.getLogger(__name__).warning("%s", warning)
    withdraw_manifest(inputs.manifest)
    files = []
    for name, views in folders.items():
        with atomic_folder(inputs.out / name, r"[\w.-]+\.exr") as folder:
            for view, layers in views.items():
                write_exr(folder / f"{view}.exr", layers)
        files += [inputs.out / name / f"{view}.exr" for view in views]
    write_manifest(inputs.manifest, "import_results", files, dumped(settings))
    return {name: len(views) for name, views in folders.items()} | {"warnings": warnings}
