"""``fipt photograph-images``: any dataset -> a whole capture of its images, taken by a simulated camera."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import DatasetFolder
from fipt.stages.synthesize.common import CaptureFolder, LastManifest, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class PhotographImagesInputs:
    """Files of ``fipt photograph-images``."""

    dataset: DatasetFolder
    raw: CaptureFolder
    manifest: LastManifest = None


def run(inputs: PhotographImagesInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Photograph all images of a dataset with a simulated camera, calibration frames too."""
    from fipt.synthetic.dataset import photograph

    begin(inputs.manifest, (inputs.raw,))
    files = photograph(inputs.dataset, inputs.raw, settings)
    views = sum(file.parent.name == "truth" and file.suffix == ".exr" for file in files)
    return finish(inputs.manifest, files, settings) | {"views": views}
