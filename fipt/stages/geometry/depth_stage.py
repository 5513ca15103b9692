"""``fipt depth``: posed HDR views -> a depth map of every training view."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder

if TYPE_CHECKING:
    from fipt.stages.geometry.settings import DepthSettings

log = logging.getLogger(__name__)

_HOLDS = r"[\w.-]+\.exr"
"""Names in a folder of depth maps, as a regular expression."""


@dataclass(frozen=True, kw_only=True)
class DepthInputs:
    """Files of ``fipt depth``."""

    dataset: DatasetFolder
    out: Annotated[Path, "Folder of the depth maps, VIEW.exr; its manifest lies beside it."]


def run(inputs: DepthInputs, settings: "DepthSettings") -> dict[str, Any]:
    """Estimate the depth of every training view from what the others show.

    Views need no mesh, only cameras: at least three that show the same surface from different
    places. A pixel has a depth where other views confirm it; bare walls have little.
    Depth maps that exist (depth.given) are checked through the cameras, and taken over.
    """
    import drjit

    from fipt.errors import FiptError
    from fipt.formats.files import atomic_folder, check_replaced, manifest_beside
    from fipt.formats.manifests import write_manifest
    from fipt.formats.places import OwnedPlaces
    from fipt.render.variant import set_variant
    from fipt.scene.dataset import Dataset
    from fipt.scene.depth_maps import write_depth_map
    from fipt.settings import dumped
    from fipt.stages.geometry.depth import check_memory, depth_maps
    from fipt.stages.geometry.given_depth import given_maps
    from fipt.stages.geometry.stereo_view import stereo_view

    dataset, out = Dataset(inputs.dataset), inputs.out
    if OwnedPlaces([("", dataset.root)]).owner(out) is not None:
        raise FiptError(
            f"the folder {out} is replaced, but lies in the dataset {dataset.root}", "choose another folder"
        )
    check_replaced(out, _HOLDS)  # told now, not after hours
    views = [stereo_view(dataset, view) for view in dataset.views("train")]
    check_memory(views, settings.memory_gb)
    known: dict[str, float] = {}
    manifest_beside(out).unlink(missing_ok=True)
    if settings.given is None:
        maps = depth_maps(getattr(drjit, set_variant().name), views, settings)
    else:
        maps = given_maps([view.camera for view in views], views, Path(settings.given), settings.unit)
    with atomic_folder(out, _HOLDS) as folder:
        for view, depth_map in maps:
            write_depth_map(folder / f"{view}.exr", depth_map)
            known[view] = round(float(depth_map.known.mean()), 4)
    files = [out / f"{view}.exr" for view in known]
    write_manifest(manifest_beside(out), "depth", files, dumped(settings))
    figures: dict[str, Any] = {"views": len(known), "known": sum(known.values()) / len(known), "known_of_view": known}
    poor = [view for view, share in known.items() if share < settings.poor]
    if poor:
        figures["warnings"] = [f"less than {settings.poor:.0%} of the pixels have a depth in {', '.join(poor)}"]
        log.warning("%s: photograph more views that show the same from near by", figures["warnings"][0])
    log.info("%s: %.0f%% of the pixels have a depth", out, 100 * figures["known"])
    return figures
