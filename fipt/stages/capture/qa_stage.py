"""``fipt qa``: developed views -> qa.json, which views are good and what is wrong with the others."""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.capture.settings import CaptureSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class QaInputs:
    """Files of ``fipt qa``."""

    capture: Annotated[Path, "Folder of the photographs."]
    developed: Annotated[Path, "Folder that fipt develop wrote."]
    calibration: Annotated[Path, "calibration.json of the camera."]
    out: Annotated[Path, "qa.json to write."]


def run(inputs: QaInputs, settings: "CaptureSettings") -> dict[str, Any]:
    """Judge a developed capture: figures of every view, findings with a severity, rejected views."""
    from fipt.formats.files import write_text
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.calibration import read_calibration
    from fipt.stages.capture.qa import report

    capture = read_capture(inputs.capture, settings.frames)
    found = report(capture, inputs.developed, read_calibration(inputs.calibration))
    write_text(inputs.out, json.dumps(found, indent=1, allow_nan=False) + "\n")
    worse = [finding for finding in found["findings"] if finding["severity"] != "note"]
    for finding in worse:
        level = logging.ERROR if finding["severity"] == "error" else logging.WARNING
        log.log(level, "%s; %s", finding["message"], finding["remedy"])
    refused = [view for view, state in found["views"].items() if not state["accepted"]]
    log.info("qa: %d of %d views are accepted", len(found["views"]) - len(refused), len(found["views"]))
    warnings = [f"{finding['message']}; {finding['remedy']}" for finding in worse]
    return {"warnings": warnings, "views": len(found["views"]), "rejected": refused}
