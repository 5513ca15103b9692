"""What the verbs of known rooms share: their files, and the manifest that says of which room they are."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings

RoomFolder = Annotated[Path, "Dataset folder that fipt synthesize-room wrote."]
SceneXml = Annotated[Path | None, "Mitsuba scene file (XML) of the room; default: the room in code."]
LastManifest = Annotated[Path | None, "Manifest to write last."]
CaptureFolder = Annotated[Path, "Capture folder to write."]


def begin(manifest: Path | None, folders: Iterable[Path] = ()) -> None:
    """Refuse folders that a manifest cannot list, since they are not below its own; take away that of an earlier run.

    Raises
    ------
    FiptError
        Of the first of them.
    """
    from fipt.errors import FiptError
    from fipt.formats.manifests import withdraw_manifest

    for folder in folders:
        if manifest is not None and not folder.is_relative_to(manifest.parent):
            raise FiptError(
                f"a manifest lists files below its own folder; {folder} is not below {manifest.parent}",
                "put the manifest into the scene's folder, above dataset and capture",
            )
    if manifest is not None:
        withdraw_manifest(manifest)


def finish(
    manifest: Path | None, files: Iterable[Path], settings: "SynthesizeSettings", scene: Path | None = None, **more: Any
) -> dict[str, Any]:
    """Write the manifest, if one is asked for; return what the settings do not say of the room."""
    from fipt.formats.manifests import write_manifest
    from fipt.settings import dumped

    if scene is not None:
        more = {"scene_file": str(scene), **more}
    if manifest is not None:
        write_manifest(manifest, "synthesize", files, dumped(settings) | more)
    return more
