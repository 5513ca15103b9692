"""What is asked of a fitted room: setups that change nothing or leave no light, outputs over inputs, old decisions."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fipt.cli.verbs import check_written
from fipt.errors import FiptError
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet
from fipt.render.variant import Backend
from fipt.scene.emitters import read_names
from fipt.scene.environment import NOTHING, constant
from fipt.scene.review import ReviewDecisions
from fipt.scene.setup import RelightSetup, parse_setup
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.review_stage import _check_decisions
from fipt.stages.render.inputs import TracedInputs
from fipt.stages.render.lights import Illumination, idle_edits, missing_light
from fipt.stages.render.placement import inside_objects
from tests import judged, scenes

BALL = {"shape": "sphere", "center": [1, 1, 1], "radius": 0.2, "radiance": [0, 0, 0]}
AT = {"position": [2, 1, 1], "target": [2, 2, 1], "up": [0, 1, 0]}


def setup(**keys: Any) -> RelightSetup:
    return parse_setup(json.dumps(keys))


IDLE = {
    "a setup of nothing": ({}, "the setup changes nothing: its images are those of the room as it is"),
    "an edit of nothing": ({"emitters": [{"index": 0}]}, "emitters.0 of the setup changes nothing"),
    "an edit that switches nothing off": ({"emitters": [{"off": False}]}, "emitters.0 of the setup changes nothing"),
    "a black light": ({"lights": [BALL]}, "lights.0 of the setup gives no light"),
    "an environment of nothing": ({"environment": {}}, "environment of the setup changes nothing"),
}


@pytest.mark.parametrize("name", IDLE)
def test_a_setup_that_changes_nothing_is_told(name: str) -> None:
    keys, said = IDLE[name]
    assert [said in warning for warning in idle_edits(setup(**keys))] == [True]


def test_a_setup_that_changes_something_is_not_told() -> None:
    assert idle_edits(setup(emitters=[{"index": 0, "scale": 1}], environment={"rotation": 90})) == []
    assert idle_edits(setup(cameras={"look_at": {"x": {"position": [1, 1, 1], "target": [2, 1, 1]}}})) == []


def test_a_room_without_light_is_told() -> None:
    lit = EmitterSet(np.array([3], np.int32), np.ones((1, 3), np.float32))
    black = EmitterSet(np.array([3], np.int32), np.zeros((1, 3), np.float32))
    turned = setup(environment={"rotation": 90})
    assert missing_light(Illumination(lit, NOTHING), setup()) == []
    assert "all images are black" in missing_light(Illumination(black, NOTHING), setup())[0]
    assert "of which there is none" in missing_light(Illumination(lit, NOTHING), turned)[0]
    assert missing_light(Illumination(black, constant((1, 1, 1), "y")), turned) == []


REFUSED = {
    "a black color of light": ({"emitters": [{"index": 0, "color": [0, 0, 0]}]}, "black is no color of light"),
    "a map and a radiance": ({"environment": {"file": "a.exr", "radiance": [1, 1, 1]}}, "file or radiance, not both"),
    "a camera that looks up its up": ({"cameras": {"look_at": {"x": AT}}}, "up must not be the direction in which"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_setup_that_means_two_things(name: str) -> None:
    keys, said = REFUSED[name]
    with pytest.raises(FiptError, match=said):
        setup(**keys)


def test_a_camera_in_an_object_is_told(backend: Backend) -> None:
    camera = judged.camera(0)
    around = scenes.box(tuple(camera.center - 0.2), tuple(camera.center + 0.2))
    scene = RayScene(scenes.joined(judged.mesh(), around))
    assert (
        "around the cameras of v0" in inside_objects(scene, [camera, judged.camera(5)], len(judged.mesh().triangles))[0]
    )
    assert inside_objects(scene, [judged.camera(5)], len(judged.mesh().triangles)) == []


def asked(out: Path, **keys: Any) -> TracedInputs:
    made = Path("dataset")
    (made / "images").mkdir(parents=True, exist_ok=True)
    (made / "mesh.ply").touch()
    files = dict.fromkeys(("cache", "model", "emitters"), Path("x"))
    return TracedInputs(**({"dataset": made, "out": out, "manifest": Path("m.json")} | files | keys))


def test_no_output_lies_in_the_images_of_a_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for inputs in (
        asked(Path("dataset/images")),
        asked(Path("dataset/images/new")),
        asked(Path("o"), manifest=Path("dataset/../dataset/mesh.ply")),
    ):
        with pytest.raises(FiptError, match=r"lies in what --dataset reads, .*: it would be overwritten; change --"):
            check_written(inputs)
    check_written(asked(Path("dataset/render")))


@pytest.mark.parametrize("rays", [0, -1, 65, 1000])
def test_rays_of_a_pixel(rays: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FiptError, match=f"--rays-per-side must be 1 to 64; it is {rays}"):
        asked(Path("o"), rays_per_side=rays)


def test_decisions_that_contradict_each_other() -> None:
    both = ReviewDecisions(mesh_triangles=20, accept=("18-19",), reject=("5", "19"))
    with pytest.raises(FiptError, match="triangle 19 must be accepted or rejected; decisions do both"):
        Decided.of(both, 20)


def test_names_of_other_emitters(tmp_path: Path) -> None:
    path = tmp_path / "emitters.json"
    path.write_text(json.dumps({"emitters": [{"index": 3, "name": "ceiling"}]}))
    with pytest.raises(FiptError, match="its emitters must be numbered from 0, in order"):
        read_names(path, judged.emitters())


def test_a_review_of_another_mesh(tmp_path: Path) -> None:
    path = tmp_path / "emitters_review.yaml"
    path.write_text('mesh_triangles: 999\nemitters:\n- {verdict: accept, triangles: "18"}\n')
    with pytest.raises(FiptError, match="decides about triangles of a mesh of 999; the mesh has 20"):
        _check_decisions(path, 20)
    path.write_text('mesh_triangles: 999\nemitters:\n- {triangles: "18"}\n')
    _check_decisions(path, 20)  # nothing is lost
