"""``fipt synthesize-relit``: a known room and a relight setup -> how some views truly look under it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import Names
from fipt.stages.synthesize.common import LastManifest, RoomFolder, SceneXml, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class SynthesizeRelitInputs:
    """Files of ``fipt synthesize-relit``."""

    dataset: RoomFolder
    views: Names
    setup: Annotated[str, "Relight setup, JSON or YAML file."]
    setup_name: Annotated[str, "Its name: the images go to relight_truth/NAME/."]
    scene: SceneXml = None
    manifest: LastManifest = None


def run(inputs: SynthesizeRelitInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Render views of a known room under a relight setup, as the truth of relighting."""
    from fipt.formats.files import check_name
    from fipt.scene.setup import parse_setup
    from fipt.settings import dumped
    from fipt.synthetic.dataset import write_images

    setup = parse_setup(inputs.setup)
    check_name(inputs.setup_name, "relight setup")
    begin(inputs.manifest)
    files, rate = write_images(inputs.dataset, inputs.views, settings, inputs.scene, setup, inputs.setup_name)
    more = finish(inputs.manifest, files, settings, inputs.scene, setup=dumped(setup))
    return more | {"views": len(inputs.views), "paths_per_second": round(rate)}
