"""``fipt photograph``: a known room -> RAW brackets of some views, taken by a simulated camera."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import Names
from fipt.stages.synthesize.common import CaptureFolder, LastManifest, RoomFolder, SceneXml, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class PhotographInputs:
    """Files of ``fipt photograph``."""

    dataset: RoomFolder
    views: Names
    raw: CaptureFolder
    scene: SceneXml = None
    manifest: LastManifest = None


def run(inputs: PhotographInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Photograph views of a known room into RAW brackets; their ids and truth go to the dataset.

    The camera is the section raw of the settings. fipt photograph-calibration writes what a capture has once.
    """
    from fipt.synthetic.dataset import write_brackets

    begin(inputs.manifest, (inputs.raw, inputs.dataset))
    files, rate = write_brackets(inputs.dataset, inputs.raw, inputs.views, settings, inputs.scene)
    more = finish(inputs.manifest, files, settings, inputs.scene)
    return more | {"views": len(inputs.views), "paths_per_second": round(rate)}
