"""``fipt mesh``: depth maps of posed views -> the room's mesh."""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder

if TYPE_CHECKING:
    from fipt.stages.geometry.mesh_settings import GeometrySettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class MeshInputs:
    """Files of ``fipt mesh``."""

    dataset: DatasetFolder
    depth: Annotated[Path, "Folder of the depth maps of the training views, VIEW.exr."]
    out: Annotated[Path, "Folder for mesh.ply, geometry.json, planes.json and overview.png."]
    first: Annotated[Path | None, "Folder of the mesh of all views, with --checked: taken over where none fails."] = (
        None
    )
    checked: Annotated[Path | None, "Verdicts of fipt check-poses: views that it rejected are left out."] = None


_FILES = "geometry.json", "planes.json", "overview.png", "mesh.ply"
"""What a folder of a mesh holds."""


def run(inputs: MeshInputs, settings: "GeometrySettings") -> dict[str, Any]:
    """Make one mesh of the depth maps of the training views.

    Bare surface is completed by the planes of what lies beside it, the maps are fused, and the
    surface is smoothed, flattened, decimated and cut like a scan's. The dataset needs no mesh.
    A scan that exists (geometry.scan) is brought to the cameras instead. geometry.method `sdf` fits the fused surface
    to the photographs by volume rendering, `monosdf` one that starts as a sphere.
    A mesh is made in two steps: a first one of all views; then, without those whose camera it proves wrong.
    """
    from fipt.formats.files import copy_file, make_folder, write_text
    from fipt.formats.images import write_png
    from fipt.formats.views import read_rejected
    from fipt.scene.cameras import read_origin
    from fipt.scene.dataset import Dataset
    from fipt.scene.mesh import write_ply
    from fipt.stages.geometry.build import build
    from fipt.stages.geometry.depth_views import read_views
    from fipt.stages.geometry.library import check_importable
    from fipt.stages.geometry.mesh_settings import ScanSettings
    from fipt.stages.geometry.scan import from_scan

    rejected = {} if inputs.checked is None else read_rejected(inputs.checked)
    if inputs.first is not None and not rejected:
        make_folder(inputs.out)
        for name in _FILES:
            copy_file(inputs.first / name, inputs.out / name)
        return {"rejected": []}
    for view, reason in rejected.items():
        log.warning("%s %s: the mesh is made once more without it", view, reason)
    check_importable()  # told now, not after the planes
    dataset = Dataset(inputs.dataset)
    views = read_views(dataset, inputs.depth, rejected)
    if isinstance(settings, ScanSettings) and settings.scan is not None:
        origin = read_origin(inputs.dataset / "transforms.json")
        made = from_scan(views, Path(settings.scan), dataset.image, settings, origin)
    else:
        made = build(views, dataset.image, settings)
    make_folder(inputs.out)
    write_text(
        inputs.out / "geometry.json", json.dumps(made.about | {"rejected": rejected}, indent=1, allow_nan=False) + "\n"
    )
    write_text(inputs.out / "planes.json", json.dumps(made.planes, indent=1, allow_nan=False) + "\n")
    write_png(inputs.out / "overview.png", made.image)
    write_ply(inputs.out / "mesh.ply", made.mesh)
    return made.figures | {"rejected": list(rejected)}
