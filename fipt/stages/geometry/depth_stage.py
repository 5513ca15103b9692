"""``fipt depth``: posed HDR views -> a depth map of every training view."""

import logging
from collections.abc import Sequence
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
    layout: Annotated[
        Path | None, "nerfstudio's transforms.json, or its folder, that names depth maps that exist; default: none."
    ] = None


def run(inputs: DepthInputs, settings: "DepthSettings") -> dict[str, Any]:
    """Estimate the depth of every training view from what the others show.

    Views need no mesh, only cameras: at least three that show the same surface from different
    places. A pixel has a depth where other views confirm it; bare walls have little.
    Depth maps that exist (depth.given, or depth_file_path of a layout) are checked through the
    cameras, and taken over.
    """
    import drjit

    from fipt.errors import FiptError
    from fipt.formats.files import atomic_folder, check_replaced, manifest_beside
    from fipt.formats.manifests import withdraw_manifest, write_manifest
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
    withdraw_manifest(manifest_beside(out))
    files = _given(inputs.layout, [view.camera.name for view in views], settings)
    if files:
        shown = [dataset.shown(view.camera.name) for view in views]
        maps = given_maps(views, shown, files, settings.unit)
    else:
        maps = depth_maps(getattr(drjit, set_variant().name), views, settings)
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


def _given(layout: Path | None, views: Sequence[str], settings: "DepthSettings") -> dict[str, Path]:
    """View -> its depth map that exists: in the folder of the settings, or as the layout names it; else nothing."""
    from fipt.errors import FiptError
    from fipt.scene.sources import read_source
    from fipt.stages.geometry.settings import STEREO, given_file

    if settings.given == STEREO:
        return {}
    if settings.given is not None:
        return {view: given_file(Path(settings.given), view) for view in views}
    if layout is None:
        return {}
    named = {frame.name: frame.depth for frame in read_source(layout, "nerfstudio").frames}
    files = {view: path for view in views if (path := named.get(view)) is not None}
    if len(files) < len(views):
        missing = next(view for view in views if view not in files)
        raise FiptError(f"{layout} must name the depth of {missing} (depth_file_path)", "add it")
    return files
