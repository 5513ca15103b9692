"""``fipt develop``: photographs and calibration -> HDR views."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import ManifestFile, Names

if TYPE_CHECKING:
    from fipt.stages.capture.settings import CaptureSettings


@dataclass(frozen=True, kw_only=True)
class DevelopInputs:
    """Files of ``fipt develop``."""

    capture: Annotated[Path, "Folder of the photographs."]
    views: Names
    calibration: Annotated[Path, "calibration.json of the camera."]
    out: Annotated[Path, "Folder to write: hdr/VIEW.exr and VIEW.json."]
    manifest: ManifestFile
    keep_going: Annotated[bool, "Reject views that cannot be developed instead of stopping."] = False


def run(inputs: DevelopInputs, settings: "CaptureSettings") -> dict[str, Any]:
    """Develop brackets into calibrated, undistorted HDR views."""
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.settings import dumped
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.calibration import read_calibration
    from fipt.stages.capture.develop import develop_views

    found, names = read_capture(inputs.capture, settings.frames), list(inputs.views)
    calibration = read_calibration(inputs.calibration)
    withdraw_manifest(inputs.manifest)
    files = develop_views(found, names, calibration, inputs.out, settings, inputs.keep_going)
    write_manifest(inputs.manifest, "capture", files, dumped(settings))
    return {"views": len(names)}
