"""Where outputs of another program lie, in two layouts: files of numbered views.

``albedo`` is the directional albedo, ``kd`` or ``diffuse`` the diffuse reflectance. A quantity is there for all views
or for none: one that is not there stays unknown.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fipt.errors import FiptError
from fipt.stages.import_results.settings import ImportResultsSettings

log = logging.getLogger(__name__)

DEPTH = "depth"
"""What a method may have been given of the mesh: no estimate, but it tells whether view and unit are ours."""
_EXR = {"albedo": "reflectance", "kd": "kd", "roughness": "roughness", "emission": "emission", "depth": DEPTH}
"""Their quantity -> our layer."""
_SHOWN = ("viewsynthesis", "relight")
_ENDINGS = ("", "_rgb")
"""What an image's name may have after its number."""


@dataclass(frozen=True)
class OtherResults:
    """Files of another program.

    Attributes
    ----------
    materials
        Our layer -> view -> file; files of the layout `npz` hold all layers.
    images
        ``viewsynthesis``, ``relight`` -> view -> file.
    """

    materials: Mapping[str, Mapping[str, Path]]
    images: Mapping[str, Mapping[str, Path]]

    def files(self) -> list[Path]:
        """Every file, once."""
        listed = [*self.materials.values(), *self.images.values()]
        return sorted({path for paths in listed for path in paths.values()})


def found_results(
    settings: ImportResultsSettings,
    scene: str,
    materials: Sequence[str],
    held_out: Sequence[str],
    photographed: Collection[str] | None = None,
    rejected: Collection[str] = (),
) -> OtherResults:
    """Look for files, and check that none is missing of a quantity that is there.

    Parameters
    ----------
    settings
        Where to look.
    scene
        Name of the scene here.
    materials, held_out
        Views whose materials are numbered, and held-out views.
    photographed
        Views with a photograph under the light of the setup; None: its truth has all of them.
    rejected
        Views that are not used; they have numbers all the same.

    Raises
    ------
    FiptError
        If files of some views are missing, or ``only`` names a view that is none of these.
    """
    unknown = [name for name in settings.only if name not in {*materials, *held_out}]
    if unknown:
        raise FiptError(
            f"import_results.only names {', '.join(unknown)}, no view of {settings.views} and none held out",
            "name views of the scene",
        )
    folder, *others = result_folders(settings, scene)
    own, shown = (_chosen(views, settings.only, rejected) for views in (materials, held_out))
    if settings.layout == "npz":
        files = _numbered(folder, "{:06d}.npz", own, len(materials))
        return OtherResults({"npz": files} if files else {}, {})
    quantities = {ours: _numbered(folder, f"{{:03d}}_{name}.exr", own, len(materials)) for name, ours in _EXR.items()}
    images = {}
    for kind, place in zip(_SHOWN, others, strict=False):
        under = photographed if kind == "relight" and photographed is not None else shown
        views = {view: number for view, number in shown.items() if view in under}
        tried = [_numbered(place, f"{{:03d}}{ending}.exr", views, len(held_out)) for ending in _ENDINGS]
        images[kind] = next((files for files in tried if files), {})
    there = {name: files for name, files in quantities.items() if files}
    return OtherResults(there, {kind: files for kind, files in images.items() if files})


def _chosen(views: Sequence[str], only: Collection[str], rejected: Collection[str]) -> dict[str, int]:
    """View -> its number among ``views``, of all or ``only`` some, without those that are rejected."""
    used = {view: number for number, view in enumerate(views) if view not in rejected}
    return {view: number for view, number in used.items() if not only or view in only}


def result_folders(settings: ImportResultsSettings, scene: str) -> list[Path]:
    """Folders that are read of a scene: of materials, of held-out views, of relit ones where a setup is named."""
    root = Path(settings.path or "")
    if settings.layout == "npz":
        return [root]
    kinds = ("brdf", *(_SHOWN if settings.setup else _SHOWN[:1]))
    return [root / kind / settings.method / (settings.scene or scene) for kind in kinds]


def _numbered(folder: Path, pattern: str, views: Mapping[str, int], count: int) -> dict[str, Path]:
    """View -> its file, by the views' numbers below ``count``; none where there is none."""
    files = {view: folder / pattern.format(number) for view, number in views.items()}
    missing = [path.name for path in files.values() if not path.is_file()]
    if len(missing) == len(files):
        return {}
    if missing:
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise FiptError(
            f"{folder} must hold a file for each of {len(files)} views; {', '.join(missing[:4])}{more} missing",
            "export the others too, remove them all, or name in import_results.only the views that are there",
        )
    if (more := folder / pattern.format(count)).is_file():
        log.warning("%s: there are %d views, so files from this one on are of none; do the numbers fit?", more, count)
    return files
