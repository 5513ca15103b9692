"""``fipt photograph-calibration``: a known room -> what a simulated capture of it has once."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.stages.synthesize.common import CaptureFolder, LastManifest, RoomFolder, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class PhotographCalibrationInputs:
    """Files of ``fipt photograph-calibration``."""

    dataset: RoomFolder
    raw: CaptureFolder
    manifest: LastManifest = None


def run(inputs: PhotographCalibrationInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Take the calibration frames of the simulated camera; write the capture's table of frames, cameras and mesh."""
    from fipt.synthetic.dataset import write_capture_rest

    begin(inputs.manifest, (inputs.raw,))
    return finish(inputs.manifest, write_capture_rest(inputs.dataset, inputs.raw, settings), settings)
