"""Where outputs of another program lie, in two layouts: files of numbered views.

``albedo`` is the directional albedo, ``kd`` or ``diffuse`` the diffuse reflectance. A quantity is there for all views
or for none: one that is not there stays unknown.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fipt.errors import FiptError
from fipt.stages.import_results.settings import ImportResultsSettings

log = logging.getLogger(__name__)

_EXR = {"albedo": "reflectance", "kd": "kd", "roughness": "roughness", "emission": "emission"}
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
        Our layer -> file of each view, in the order of the views; files of the layout `npz` hold all layers.
    images
        ``viewsynthesis``, ``relight`` -> file of each view.
    """

    materials: Mapping[str, Sequence[Path]]
    images: Mapping[str, Sequence[Path]]

    def files(self) -> list[Path]:
        """Every file, once."""
        listed = [*self.materials.values(), *self.images.values()]
        return sorted({path for paths in listed for path in paths})


def found_results(settings: ImportResultsSettings, scene: str, materials: int, images: int) -> OtherResults:
    """Look for files, and check that none is missing of a quantity that is there.

    Parameters
    ----------
    settings
        Where to look.
    scene
        Name of the scene here.
    materials, images
        Number of views whose materials are numbered, and of held-out views.

    Raises
    ------
    FiptError
        If files of some views are missing.
    """
    folder, *others = result_folders(settings, scene)
    if settings.layout == "npz":
        files = _numbered(folder, "{:06d}.npz", materials)
        return OtherResults({"npz": files} if files else {}, {})
    quantities = {ours: _numbered(folder, f"{{:03d}}_{name}.exr", materials) for name, ours in _EXR.items()}
    shown = {}
    for kind, own in zip(_SHOWN, others, strict=False):
        tried = [_numbered(own, f"{{:03d}}{ending}.exr", images) for ending in _ENDINGS]
        shown[kind] = next((files for files in tried if files), [])
    there = {name: files for name, files in quantities.items() if files}
    return OtherResults(there, {kind: files for kind, files in shown.items() if files})


def result_folders(settings: ImportResultsSettings, scene: str) -> list[Path]:
    """Folders that are read of a scene: of materials, of held-out views, of relit ones where a setup is named."""
    root = Path(settings.path or "")
    if settings.layout == "npz":
        return [root]
    kinds = ("brdf", *(_SHOWN if settings.setup else _SHOWN[:1]))
    return [root / kind / settings.method / (settings.scene or scene) for kind in kinds]


def _numbered(folder: Path, pattern: str, count: int) -> list[Path]:
    """Files 0 to count - 1; none where there is none."""
    files = [folder / pattern.format(number) for number in range(count)]
    missing = [path.name for path in files if not path.is_file()]
    if len(missing) == count:
        return []
    if missing:
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise FiptError(
            f"{folder} must hold a file for each of {count} views; {', '.join(missing[:4])}{more} missing",
            "export the others too, or remove them all",
        )
    if (more := folder / pattern.format(count)).is_file():
        log.warning("%s: there are %d views, so files from this one on are of none; do the numbers fit?", more, count)
    return files
