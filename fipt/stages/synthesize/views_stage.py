"""``fipt synthesize-views``: a known room -> images, segment ids and ground truth of some views."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import Names
from fipt.stages.synthesize.common import LastManifest, RoomFolder, SceneXml, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class SynthesizeViewsInputs:
    """Files of ``fipt synthesize-views``."""

    dataset: RoomFolder
    views: Names
    scene: SceneXml = None
    manifest: LastManifest = None


def run(inputs: SynthesizeViewsInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Render images, segment ids and ground truth of views of a known room."""
    from fipt.synthetic.dataset import write_images

    begin(inputs.manifest)
    files, rate = write_images(inputs.dataset, inputs.views, settings, inputs.scene)
    more = finish(inputs.manifest, files, settings, inputs.scene)
    return more | {"views": len(inputs.views), "paths_per_second": round(rate)}
