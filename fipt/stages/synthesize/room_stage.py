"""``fipt synthesize-room``: settings, or a scene file -> mesh, cameras and names of a known room."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import DatasetFolder
from fipt.stages.synthesize.common import LastManifest, SceneXml, begin, finish

if TYPE_CHECKING:
    from fipt.synthetic.settings import SynthesizeSettings


@dataclass(frozen=True, kw_only=True)
class SynthesizeRoomInputs:
    """Files of ``fipt synthesize-room``."""

    dataset: DatasetFolder
    scene: SceneXml = None
    manifest: LastManifest = None


def run(inputs: SynthesizeRoomInputs, settings: "SynthesizeSettings") -> dict[str, Any]:
    """Build a room in code, or one of a scene file, and place its cameras.

    Writes mesh, cameras, names of ids and room.json. The other verbs of known rooms start from this folder:
    synthesize-views and synthesize-relit render it; photograph-calibration and photograph take it through a
    simulated camera, and synthesize-truth gives what was developed of that its truth.
    """
    from fipt.synthetic.dataset import write_room

    begin(inputs.manifest)
    files, coverage, warnings = write_room(inputs.dataset, settings, inputs.scene)
    return finish(inputs.manifest, files, settings, inputs.scene) | {"coverage": coverage, "warnings": warnings}
