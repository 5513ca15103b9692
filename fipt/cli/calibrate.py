"""``fipt calibrate``: calibration frames -> calibration.json."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import SettingsJson, StatsFile, stage


def command(
    capture: Annotated[Path, typer.Option(help="Folder of the photographs, with calibration/ in it.")],
    out: Annotated[Path, typer.Option(help="calibration.json to write.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Calibrate the camera of a capture: black, bad pixels, vignetting, lens, white balance."""
    with stage("capture", settings, stats, backend=False) as (chosen, figures):
        from fipt.stages.capture.brackets import read_capture
        from fipt.stages.capture.calibrate import calibrate, summary
        from fipt.stages.capture.calibration import write_calibration

        found = calibrate(read_capture(capture, chosen.frames), chosen)
        write_calibration(out, found)
        figures["sources"] = found.sources
        print(summary(found))
