"""``fipt relight``: model, emitters and a light setup -> the views under other light."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import EmitterNames
from fipt.stages.render.inputs import TracedInputs

if TYPE_CHECKING:
    from fipt.scene.cameras import Camera
    from fipt.scene.dataset import Dataset
    from fipt.scene.setup import RelightSetup
    from fipt.stages.render.settings import RelightSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class RelightInputs(TracedInputs):
    """Files of ``fipt relight``."""

    setup: Annotated[str, "Setup, JSON or YAML file: lights, objects, materials, what goes."]
    views: Annotated[tuple[str, ...], "Views, comma-separated; of a setup without cameras of its own."] = ()
    cameras: Annotated[
        tuple[str, ...], "Of a setup with its own cameras: those to render, comma-separated; default: all."
    ] = ()
    emitter_names: EmitterNames = None
    segments: Annotated[Path | None, "fusion.npz, whose ids the setup names; default: connected parts of the mesh."] = (
        None
    )


def run(inputs: RelightInputs, settings: "RelightSettings") -> dict[str, Any]:
    """Render views under another light setup; or what the setup's own cameras see.

    Views that a check rejected are left out.
    """
    from fipt.render.scene import RayScene
    from fipt.scene.dataset import Dataset
    from fipt.scene.setup import parse_setup
    from fipt.stages.render.lights import crowded_things, idle_edits, idle_lights, idle_objects, missing_light
    from fipt.stages.render.placement import inside_objects, unlikely_viewpoints
    from fipt.stages.render.views import Destination, StagedScene, write_views

    setup, data = parse_setup(inputs.setup), Dataset(inputs.dataset)
    cameras = _cameras(inputs, setup, data)
    here = setup.in_unit(data.radiance_scale)
    scene = StagedScene.relit(inputs.fitted(data), here, inputs.emitter_names, inputs.segments)
    (lit,) = scene.illuminations.values()
    warnings = (
        idle_edits(setup)
        + missing_light(lit, here)
        + idle_lights(scene.mesh, here, cameras)
        + idle_objects(scene.mesh, scene.changes.counts, cameras)
        + crowded_things(scene.mesh, here, scene.changes.counts)
    )
    if setup.cameras is not None:
        warnings += unlikely_viewpoints(RayScene(scene.mesh), cameras, data.cameras)
    elif scene.changes.counts:
        warnings += inside_objects(RayScene(scene.mesh), cameras, scene.changes.first_object)
    for warning in warnings:
        log.warning("%s", warning)
    to = Destination("relight", inputs.out, inputs.manifest)
    noted = {"setup": setup.model_dump(mode="json", exclude_defaults=True)}
    rate = write_views(scene, cameras, settings, inputs.rays_per_side, to, noted)
    return {"warnings": warnings, "paths_per_s": rate}


def _cameras(inputs: RelightInputs, setup: "RelightSetup", data: "Dataset") -> "list[Camera]":
    """Views of the dataset, or the setup's own cameras.

    Raises
    ------
    FiptError
        If the options ask for the other kind.
    """
    from fipt.errors import FiptError
    from fipt.stages.render.cameras import chosen_cameras

    if setup.cameras is not None:
        return chosen_cameras(setup.cameras, data, inputs.cameras)
    if inputs.cameras:
        raise FiptError("--cameras needs a setup with cameras", "leave it out, and give --views")
    if not inputs.views:
        raise FiptError("there are no views to relight", "give --views, or a setup with cameras")
    return [data.camera(view) for view in data.accepted(inputs.views)]
