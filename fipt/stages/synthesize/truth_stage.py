"""``fipt synthesize-truth``: developed photographs of a known room -> their segment ids and ground truth."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import DatasetFolder, Names
from fipt.stages.synthesize.common import LastManifest, SceneXml, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class SynthesizeTruthInputs:
    """Files of ``fipt synthesize-truth``."""

    dataset: DatasetFolder
    views: Names
    scene: SceneXml = None
    manifest: LastManifest = None


def run(inputs: SynthesizeTruthInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Look up segment ids and ground truth of views whose images are developed photographs of a known room."""
    from fipt.synthetic.dataset import write_truths

    begin(inputs.manifest)
    files = write_truths(inputs.dataset, inputs.views, settings, inputs.scene)
    return finish(inputs.manifest, files, settings, inputs.scene)
