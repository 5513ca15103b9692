"""``fipt qa``: developed views -> qa.json, which views are good and what is wrong with the others."""

import json
from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import SettingsJson, StatsFile, stage


def command(
    capture: Annotated[Path, typer.Option(help="Folder of the photographs.")],
    developed: Annotated[Path, typer.Option(help="Folder that fipt develop wrote.")],
    calibration: Annotated[Path, typer.Option(help="calibration.json of the camera.")],
    out: Annotated[Path, typer.Option(help="qa.json to write.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Judge a developed capture: figures of every view, findings with a severity, rejected views."""
    with stage("capture", settings, stats, backend=False) as (chosen, figures):
        from fipt.formats.files import write_text
        from fipt.stages.capture.brackets import read_capture
        from fipt.stages.capture.calibration import read_calibration
        from fipt.stages.capture.qa import report

        found = report(read_capture(capture, chosen.frames), developed, read_calibration(calibration))
        write_text(out, json.dumps(found, indent=1, allow_nan=False) + "\n")
        worse = [finding for finding in found["findings"] if finding["severity"] != "note"]
        figures["warnings"] = [f"{finding['message']}; {finding['remedy']}" for finding in worse]
        for finding in worse:
            print(f"{finding['severity']}: {finding['message']}; {finding['remedy']}")
        refused = [view for view, state in found["views"].items() if not state["accepted"]]
        figures["views"], figures["rejected"] = len(found["views"]), refused
        print(f"qa: {len(found['views']) - len(refused)} of {len(found['views'])} views are accepted")
