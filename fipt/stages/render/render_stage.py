"""``fipt render``: model and emitters -> views, path traced."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import Names
from fipt.stages.render.inputs import TracedInputs

if TYPE_CHECKING:
    from fipt.stages.render.settings import RenderSettings


@dataclass(frozen=True, kw_only=True)
class RenderInputs(TracedInputs):
    """Files of ``fipt render``."""

    views: Names


def run(inputs: RenderInputs, settings: "RenderSettings") -> dict[str, Any]:
    """Re-render views with the model. Views that a check rejected are left out."""
    from fipt.scene.dataset import Dataset
    from fipt.stages.render.views import Destination, StagedScene, write_views

    data = Dataset(inputs.dataset)
    cameras = [data.camera(view) for view in data.accepted(inputs.views)]
    scene = StagedScene.as_fitted(inputs.fitted(data))
    to = Destination("render", inputs.out, inputs.manifest)
    return {"paths_per_s": write_views(scene, cameras, settings, inputs.rays_per_side, to)}
