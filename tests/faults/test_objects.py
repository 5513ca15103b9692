"""Objects of setups: what their files name, and what stands there."""

import json
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.images import write_png
from fipt.scene.objects import read_object
from fipt.scene.setup import parse_setup

SHAPE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3\n"
WITH = f"mtllib a.mtl\n{SHAPE}usemtl a\n{FACE}"


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def written(material: str = "Kd 1 0 0\n", text: str = WITH) -> Path:
    Path("a.mtl").write_text(f"newmtl a\n{material}")
    Path("o.obj").write_text(text)
    return Path("o.obj")


NUMBERS = {
    "a colour of words": ("Kd x y z\n", r"a\.mtl, line 2: Kd must be three numbers from 0 to 1; found 'x y z'"),
    "a colour of 255": ("Kd 255 0 0\n", "Kd must be three numbers from 0 to 1; found '255 0 0'"),
    "a negative colour": ("Kd -1 0 0\n", "Kd must be three numbers"),
    "a colour of two numbers": ("Kd 1 0\n", "Kd must be three numbers"),
    "a shininess of nan": ("Ns nan\n", "Ns must be a number from 0"),
    "a negative shininess": ("Ns -5\n", "Ns must be a number from 0"),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_materials_have_numbers_that_can_be(name: str) -> None:
    text, said = NUMBERS[name]
    with pytest.raises(FiptError, match=said):
        read_object(written(text))


NEUTRAL = {
    "no materials": (SHAPE + FACE, ""),
    "materials that are not there": (WITH.replace("a.mtl", "b.mtl"), "o.obj names the materials b.mtl, which are not"),
    "materials of a name that no disk has": (WITH.replace("a.mtl", "b" * 400), "names the materials bbb"),
    "a material that nothing defines": (
        WITH.replace("usemtl a", "usemtl b"),
        "o.obj uses the material b, which no file",
    ),
}


@pytest.mark.parametrize("name", NEUTRAL)
def test_what_has_no_material_is_neutral(name: str, caplog: pytest.LogCaptureFixture) -> None:
    text, said = NEUTRAL[name]
    np.testing.assert_allclose(read_object(written(text=text)).materials[0].base_color, 0.5)
    assert said in caplog.text


def test_an_image_that_is_not_there(caplog: pytest.LogCaptureFixture) -> None:
    made = read_object(written("Kd 1 0 0\nmap_Kd no.png\n"))
    np.testing.assert_allclose(made.materials[0].base_color.ravel(), [1, 0, 0])
    assert "a.mtl names the image no.png, which is not there: colours are those of Kd" in caplog.text


def test_an_image_that_is_broken() -> None:
    Path("a.png").write_text("PNG")
    with pytest.raises(FiptError, match=r"a\.png is not a readable image"):
        read_object(written("map_Kd a.png\n"))
    write_png(Path("a.png"), np.zeros((2, 2), np.uint8))
    read_object(written("map_Kd a.png\n"))


def test_a_shape_without_size() -> None:
    Path("o.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(FiptError, match=r"none of the triangles of o\.obj has an area"):
        read_object(Path("o.obj"))


def test_a_folder_where_a_file_must_be() -> None:
    with pytest.raises(FiptError, match=r"an object's file must be a file; \. is a folder"):
        read_object(Path())


CUBE = {"shape": "cube", "position": [0, 0, 0]}
SETUPS = {
    "no place": ({"objects": [{"shape": "cube"}]}, "setup.objects.0.position is missing"),
    "shape and file": ({"objects": [CUBE | {"file": "a"}]}, "needs either file or shape"),
    "no size": ({"objects": [CUBE | {"size": 0}]}, "setup.objects.0.size"),
    "a mirrored one": ({"objects": [CUBE | {"scale": -1}]}, "setup.objects.0.scale"),
    "a turn of words": ({"objects": [CUBE | {"rotation": "x"}]}, "setup.objects.0.rotation"),
    "a colour of 255": ({"objects": [CUBE | {"base_color": [255, 0, 0]}]}, "setup.objects.0.base_color.0"),
    "nothing removed": ({"remove": [{}]}, "give one of segment, at and box"),
    "two things removed at once": ({"remove": [{"segment": 1, "at": [0, 0, 0]}]}, "give one of segment, at and box"),
    "a box without size": ({"remove": [{"box": {"center": [0, 0, 0], "size": [0, 1, 1]}}]}, "setup.remove.0.box.size"),
    "no change of a material": ({"materials": [{"segment": 1}]}, "give at least one of"),
}


@pytest.mark.parametrize("name", SETUPS)
def test_an_object_of_a_setup_that_cannot_be(name: str) -> None:
    setup, said = SETUPS[name]
    with pytest.raises(FiptError) as caught:
        parse_setup(json.dumps(setup))
    assert said in str(caught.value)
