"""``fipt check-capture``: what is wrong with a folder of photographs, before anyone develops them."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import POSITIONAL

if TYPE_CHECKING:
    from rich.table import Table

    from fipt.stages.capture.brackets import Capture, Finding
    from fipt.stages.capture.quality import Quality
    from fipt.stages.capture.settings import CaptureSettings

_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}


@dataclass(frozen=True, kw_only=True)
class CheckCaptureInputs:
    """Files of ``fipt check-capture``; frames of None are those of the settings."""

    folder: Annotated[Path, "Folder of the photographs.", POSITIONAL]
    frames: Annotated[int | None, "Exposures of a bracket; 0 = find out. Default: that of the settings."] = None
    quick: Annotated[bool, "Read the metadata only, not the pixels."] = False


def run(inputs: CheckCaptureInputs, settings: "CaptureSettings") -> dict[str, Any]:
    """Print what is wrong with a capture, and what to do about it; nothing is written.

    Exit code 0 if nothing is worse than a warning, 2 with errors.

    Raises
    ------
    FiptError
        If a finding is an error.
    """
    from fipt.errors import FiptError
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.findings import calibration_faults, calibration_notes, check
    from fipt.stages.capture.inspection import inspect

    capture = read_capture(inputs.folder, settings.frames if inputs.frames is None else inputs.frames)
    qualities, unreadable = ([], []) if inputs.quick else inspect(capture, os.cpu_count() or 1)
    calibrated = [] if inputs.quick else calibration_faults(capture, settings)
    known = {finding.message for finding in unreadable}
    calibrated = [finding for finding in calibrated if finding.message not in known]
    findings = check(capture, [*unreadable, *calibration_notes(capture), *calibrated], qualities)
    show(capture, qualities, findings)
    errors = sum(finding.severity == "error" for finding in findings)
    if errors:
        raise FiptError(f"{errors} of the findings above are errors", "mend them, or leave those photographs out")
    return {"views": len(capture.brackets), "findings": [finding.message for finding in findings]}


def show(capture: "Capture", qualities: Sequence["Quality"], findings: Sequence["Finding"]) -> None:
    """Print a line for each view, then the findings."""
    from rich.console import Console
    from rich.text import Text

    # A log has no width: a long line stays one line there.
    console = Console(highlight=False, width=None if os.isatty(1) else 400)
    console.print(_table(capture, qualities, findings))
    for finding in findings:
        line = Text(f"{finding.severity}: ", _STYLES[finding.severity])
        console.print(line.append(f"{finding.message}; {finding.remedy}", "default"))
    if not findings:
        console.print("nothing is wrong with this capture")


def _table(capture: "Capture", qualities: Sequence["Quality"], findings: Sequence["Finding"]) -> "Table":
    from rich.table import Table
    from rich.text import Text

    from fipt.stages.capture.inspection import balance_text, span_text

    measured = {quality.view: quality for quality in qualities}
    table = Table(box=None, pad_edge=False)
    for heading in ("view", "exposures", "clipped", "noisy", "range", "sharp", "moved", "balance R B", ""):
        table.add_column(heading, justify="left" if heading in ("view", "exposures", "") else "right", no_wrap=True)
    for bracket in capture.brackets:
        kinds = [f for f in findings if bracket.view in f.views]
        marks = Text(", ").join(Text(f.kind, _STYLES[f.severity]) for f in kinds)
        quality = measured.get(bracket.view)
        figures = ["-"] * 6
        if quality is not None:
            figures = [
                f"{quality.clipped:.1%}",
                f"{quality.noisy:.1%}",
                f"{quality.dynamic_range:.1f} EV",
                f"{quality.sharpness:.2f}",
                f"{quality.moved:.1%}",
                balance_text(quality.white_balance),
            ]
        table.add_row(bracket.view, span_text(bracket), *figures, marks)
    return table
