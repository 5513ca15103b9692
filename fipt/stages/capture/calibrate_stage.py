"""``fipt calibrate``: calibration frames -> calibration.json."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.capture.settings import CaptureSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CalibrateInputs:
    """Files of ``fipt calibrate``."""

    capture: Annotated[Path, "Folder of the photographs, with calibration/ in it."]
    out: Annotated[Path, "calibration.json to write."]


def run(inputs: CalibrateInputs, settings: "CaptureSettings") -> dict[str, Any]:
    """Calibrate the camera of a capture: black, bad pixels, vignetting, lens, white balance."""
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.calibrate import calibrate, summary
    from fipt.stages.capture.calibration import write_calibration

    found = calibrate(read_capture(inputs.capture, settings.frames), settings)
    write_calibration(inputs.out, found)
    log.info("%s", summary(found))
    return {"sources": found.sources}
