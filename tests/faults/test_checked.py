"""The check of cameras: odd but sound views are not blamed, and its file is that of the dataset it lies in."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.render.variant import Backend
from fipt.scene.cameras import Camera
from fipt.scene.dataset import CHECKED
from fipt.scene.mesh import Mesh
from fipt.stages.importing.place import double_warnings
from fipt.synthetic.dataset import built
from fipt.synthetic.settings import SynthesizeSettings
from tests import room_views, scenes
from tests.faults.faults import Fault, named, refused
from tests.layouts import write_nerfstudio

WIDTH, HEIGHT, DEPTH = room_views.SIZE
BOARDS = room_views.walled()


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def cameras(count: int, size: tuple[int, int]) -> list[Camera]:
    return room_views.cameras(count, size=size, target=(WIDTH / 2, HEIGHT / 3, DEPTH / 2))


def dataset(count: int = 2, size: tuple[int, int] = (8, 6)) -> None:
    """Sound views of the box room in `data`."""
    room_views.write_dataset(Path("data"), [(c, room_views.draw(c, BOARDS)) for c in cameras(count, size)])


@pytest.mark.parametrize("size", [(60, 45), (1200, 3), (8, 6)])
def test_small_views_blame_no_mesh(size: tuple[int, int], backend: Backend, capfd: pytest.CaptureFixture[str]) -> None:
    """Of so few pixels a sound mesh seemed to be turned by 5 degrees; flat strips were reduced to nothing."""
    dataset(7, size)
    assert main(["check-poses", "data", "--reject"]) == 0
    said = capfd.readouterr().err
    assert "The mesh is not where" not in said
    assert "RuntimeWarning" not in said
    assert json.loads(Path("data", CHECKED).read_text())["findings"] == []


def verdicts(**views: dict) -> None:
    dataset()
    Path("data", CHECKED).write_text(json.dumps({"checked": True, "views": views, "findings": []}))


SOUND = {"accepted": True, "reason": ""}
FILES = [
    Fault("verdicts of another room", lambda: verdicts(v0=SOUND, hall_7=SOUND), "hall_7 is not one: it was made of"),
    Fault("a verdict in words", lambda: verdicts(v0=SOUND | {"accepted": "no"}), "accepted must be true or false"),
    Fault("a factor in words", lambda: verdicts(v0=SOUND | {"gain": "2"}), "is not a check_poses.json"),
]


@named(FILES)
def test_verdicts_that_cannot_be(fault: Fault, capsys: pytest.CaptureFixture[str]) -> None:
    fault.plant()
    assert fault.said in refused(capsys, "samples", "--dataset", "data", "--views", "v0", "--out", "s")
    assert not Path("s").exists()


def test_a_file_for_verdicts_that_are_not_written(capsys: pytest.CaptureFixture[str]) -> None:
    dataset()
    assert "--out is where --reject writes" in refused(capsys, "check-poses", "data", "--out", "o.json")


def test_an_import_that_leaves_one_row_of_pixels(backend: Backend, capsys: pytest.CaptureFixture[str]) -> None:
    """No edge can be found in it; the search for edges ended with a traceback."""
    write_nerfstudio(Path("src"))
    settings = json.dumps({"downscale": 6, "prepare": "always", "overlay": False})
    given = ("--source", "src", "--format", "nerfstudio", "--dataset", "out")
    assert main(["import", *given, "--settings", settings]) == 0


@pytest.mark.parametrize("text", ["{", "[]", '{"exposure": "much"}', ""])
def test_a_description_of_a_room_that_is_none(text: str) -> None:
    Path("room.json").write_text(text)
    with pytest.raises(FiptError, match=r"room\.json is not the description of a room"):
        built(Path(), SynthesizeSettings(), Path("room.xml"))


def test_a_mesh_in_place_of_its_folder(capsys: pytest.CaptureFixture[str]) -> None:
    write_nerfstudio(Path("src"))
    said = refused(capsys, "import", "--source", "src/mesh.ply", "--format", "nerfstudio", "--dataset", "out")
    assert "the source must be a folder or its transforms.json; src/mesh.ply is another file" in said


def test_a_single_view_is_not_sent_to_a_setting(capsys: pytest.CaptureFixture[str]) -> None:
    content = write_nerfstudio(Path("src"))
    given = ("import", "--source", "src", "--format", "nerfstudio", "--dataset", "out")
    Path("src/transforms.json").write_text(json.dumps(content | {"frames": content["frames"][:1]}))
    assert refused(capsys, *given).endswith("all 1 are val; give it more views, or a split")
    held_out = [frame | {"split": "val"} for frame in content["frames"]]
    Path("src/transforms.json").write_text(json.dumps(content | {"frames": held_out}))
    assert refused(capsys, *given).endswith("all 3 are val; make some of them train in the source's split")


@pytest.mark.parametrize(("scale", "gap", "twice"), [(0.05, 0.1, False), (0.05, 0.01, True), (1.0, 0.01, True)])
def test_panels_of_a_miniature_are_no_second_mesh(scale: float, gap: float, twice: bool, backend: Backend) -> None:
    """A box within a box, ``gap`` of the room apart: 5 cm are much in a room of 25 cm."""
    room = scenes.box((0, 0, 0), room_views.SIZE)
    middle = room_views.SIZE / 2
    inner = replace(room, vertices=(middle + (room.vertices - middle) * (1 - gap)).astype(np.float32))
    both = scenes.joined(inner, room)
    small = Mesh((both.vertices * scale).astype(np.float32), both.triangles)
    placed = []
    for camera in cameras(3, (8, 6)):
        pose = camera.world_from_camera.copy()
        pose[:3, 3] *= scale
        placed.append(replace(camera, world_from_camera=pose))
    assert bool(double_warnings(small, placed)) == twice
