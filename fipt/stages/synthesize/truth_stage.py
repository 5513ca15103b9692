"""``fipt synthesize-truth``: developed photographs of a known room -> their segment ids and ground truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    cameras: Annotated[
        Path | None, "transforms.json of where the room was photographed from; default: the dataset's own cameras."
    ] = None
    manifest: LastManifest = None


def run(inputs: SynthesizeTruthInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Look up segment ids and ground truth of views whose images are developed photographs of a known room."""
    from fipt.synthetic.dataset import write_truths

    begin(inputs.manifest)
    files = write_truths(inputs.dataset, inputs.views, settings, inputs.scene, inputs.cameras)
    return finish(inputs.manifest, files, settings, inputs.scene)
