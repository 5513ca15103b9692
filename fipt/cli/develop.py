"""``fipt develop``: photographs and calibration -> HDR views."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import ManifestFile, Names, SettingsJson, StatsFile, listed, stage


def command(
    capture: Annotated[Path, typer.Option(help="Folder of the photographs.")],
    views: Names,
    calibration: Annotated[Path, typer.Option(help="calibration.json of the camera.")],
    out: Annotated[Path, typer.Option(help="Folder to write: hdr/VIEW.exr and VIEW.json.")],
    manifest: ManifestFile,
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="Reject views that cannot be developed instead of stopping.")
    ] = False,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Develop brackets into calibrated, undistorted HDR views."""
    with stage("capture", settings, stats, backend=False) as (chosen, figures):
        from fipt.formats.manifests import write_manifest
        from fipt.settings import dumped
        from fipt.stages.capture.brackets import read_capture
        from fipt.stages.capture.calibration import read_calibration
        from fipt.stages.capture.develop import develop_views

        names = listed(views)
        found = read_capture(capture, chosen.frames)
        files = develop_views(found, names, read_calibration(calibration), out, chosen, keep_going)
        write_manifest(manifest, "capture", files, dumped(chosen))
        figures["views"] = len(names)
