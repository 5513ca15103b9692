"""``fipt import``: posed HDR views of another layout -> dataset/."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.importing.settings import ImportSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ImportInputs:
    """Files of ``fipt import``."""

    source: Annotated[Path, "Folder of the views, or its transforms.json."]
    format: Annotated[str, "nerfstudio, fipt-synthetic, fipt-real, fipt or capture."]
    dataset: Annotated[Path, "Dataset folder to write."]
    mesh: Annotated[Path | None, "PLY or OBJ mesh, or none: views alone; default: the one in the source."] = None
    manifest: Annotated[Path | None, "Default: import.manifest.json in the dataset."] = None
    poses: Annotated[Path | None, "capture: transforms.json, COLMAP folder, Metashape XML or RealityCapture CSV."] = (
        None
    )
    segments: Annotated[Path | None, "capture: folder with part/VIEW.png or semantic/VIEW.png of developed views."] = (
        None
    )
    mesh_views: Annotated[
        Path | None, "transforms.json of imported views that the mesh was made of; default: it is as the source."
    ] = None
    room: Annotated[Path | None, "capture: room.json of a known room; default: one beside poses or mesh."] = None


def run(inputs: ImportInputs, settings: "ImportSettings") -> dict[str, Any]:
    """Bring posed HDR views of another layout into the dataset form.

    The layouts share file names but not axes, so the format is never guessed. Look at overlay.png
    in the dataset afterwards: the lines are the mesh's edges and must lie on the photo's. A mesh that is noisy or
    finer than the pixels is smoothed, its planes flattened, and decimated (import.prepare); prepare.json says how.

    The format capture takes developed photographs: the folder that fipt develop and fipt qa wrote.
    """
    from fipt.stages.importing.build import Beside, import_scene

    dataset = inputs.dataset
    beside = Beside(inputs.poses, inputs.segments, inputs.room)
    done = import_scene(
        inputs.source, inputs.format, dataset, settings, inputs.mesh, inputs.manifest, beside, inputs.mesh_views
    )
    figures: dict[str, Any] = {"views": len(done.cameras), "exposure": done.source.scale, "mesh": done.mesh}
    warnings = [*done.warnings, *done.mesh.get("warnings", ())]
    if done.source.unposed:
        warnings.append(f"without a pose, left out: {', '.join(done.source.unposed)}")
    if done.source.masked:
        masked = ", ".join(done.source.masked[:3])
        warnings.append(
            f"the poses name masks of {len(done.source.masked)} views ({masked}), which are not used: they are of the "
            "photographs; give merged EXR files with weights in valid.Y"
        )
    for warning in warnings:
        log.warning("%s", warning)
    if warnings:
        figures["warnings"] = warnings
    splits = [camera.split for camera in done.cameras]
    log.info("%s: %d train and %d val views", dataset, splits.count("train"), splits.count("val"))
    return figures
