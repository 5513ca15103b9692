"""``fipt olat``: model and emitters -> views with one light at a time."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import Names
from fipt.stages.render.inputs import TracedInputs

if TYPE_CHECKING:
    from fipt.stages.render.settings import OlatSettings


@dataclass(frozen=True, kw_only=True)
class OlatInputs(TracedInputs):
    """Files of ``fipt olat``."""

    views: Names


def run(inputs: OlatInputs, settings: "OlatSettings") -> dict[str, Any]:
    """Render views with each emitter, and the light from outside, alone: their sum is the room as it is lit.

    Light transport is linear in what is emitted, so that sums of these layers are the room under other light.
    """
    from fipt.scene.dataset import Dataset
    from fipt.stages.render.lights import one_at_a_time
    from fipt.stages.render.views import Destination, StagedScene, write_views

    data = Dataset(inputs.dataset)
    fitted = inputs.fitted(data)
    illuminations = one_at_a_time(fitted.emitters, fitted.environment, settings.separate)
    scene = StagedScene(fitted, fitted.mesh, illuminations)
    # of a room without light there is nothing to see
    cameras = [data.camera(view) for view in data.accepted(inputs.views) if illuminations]
    to = Destination("olat", inputs.out, inputs.manifest)
    return {"paths_per_s": write_views(scene, cameras, settings, inputs.rays_per_side, to)}
