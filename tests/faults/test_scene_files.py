"""Scene files: unphysical numbers are taken as the nearest physical ones, and named."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.render.crowding import doubled_parts
from fipt.render.variant import Backend
from fipt.synthetic.scenefile.materials import converted, material
from fipt.synthetic.scenefile.shapes import PlacedShape, geometry
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.values import color, transform
from fipt.synthetic.scenefile.xml import Node, _check, read_tree
from fipt.synthetic.settings import SceneFile
from tests.scenes import box, joined


def rgb(text: str) -> Node:
    return Node("rgb", {"name": "eta", "value": text}, (), "scene.xml line 7")


def test_a_slightly_negative_index_is_zero_and_named(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        np.testing.assert_allclose(color(rgb("0.143, -0.002, 1.44")), [0.143, 0, 1.44])
    assert "eta has negative numbers (0.143, -0.002, 1.44), which are taken as 0" in caplog.text
    caplog.clear()
    color(rgb("0.143, 0.002, 1.44"))
    assert not caplog.text


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(FiptError, match="must be a colour of one or three numbers"):
        color(rgb("nan, 0, 1"))


def test_light_beyond_all_suns_is_refused() -> None:
    with pytest.raises(FiptError, match=r"eta must be at most 1e\+12; found '1e300'"):
        color(rgb("1e300"))


def test_what_is_referred_to_has_one_meaning(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    twice = '<bsdf type="diffuse" id="a"/>' * 2
    path.write_text(f'<scene version="3.0.0">{twice}<shape type="cube"><ref id="a"/></shape></scene>')
    with pytest.raises(FiptError, match="the id 'a' is there twice"):
        read_tree(path)
    path.write_text(f'<scene version="3.0.0">{twice}<shape type="cube"/></scene>')
    assert read_tree(path)


TREES = {
    "a property without a name": ('<shape type="cube"><float value="2"/></shape>', "a <float> in a <shape> must have"),
    "a property of no name": ('<bsdf type="diffuse"><rgb name="" value="1"/></bsdf>', "a <rgb> in a <bsdf> must have"),
    "a property twice": ('<shape type="sphere"><float name="r" value="1"/><float name="r" value="2"/></shape>',
                         "r is stated twice, with two values"),
    "two spellings of a name": ('<shape type="cube"><transform name="toWorld"/><transform name="to_world"><scale '
                                'value="2"/></transform></shape>', "to_world is stated twice"),
    "an element of no kind": ('<shap type="sphere"/>', "scene files have no element <shap>"),
    "a property of no kind": ('<shape type="sphere"><flot name="radius" value="2"/></shape>', "no element <flot>"),
}  # fmt: skip


@pytest.mark.parametrize("name", TREES)
def test_an_element_that_cannot_be(name: str, tmp_path: Path) -> None:
    text, said = TREES[name]
    with pytest.raises(FiptError, match=f"s.xml line 1: .*{said}"):
        node(text, tmp_path)


def test_a_property_twice_of_one_value_is_one() -> None:
    found = Node("shape", {}, (Node("float", {"name": "a", "value": "1"}, (), "x"),) * 2, "y")
    _check(found, Path())


@pytest.mark.parametrize("version", ["banana", "", "-1", ".", "99.0", "3.0.0.0", "3.x"])
def test_a_version_of_no_mitsuba(version: str, tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(f'<scene version="{version}"/>' if version else "<scene/>")
    with pytest.raises(FiptError, match=r"the version of a scene file must be that of Mitsuba, 0\.5 to 3; found"):
        read_tree(path)


def test_a_truth_value_of_another_word(tmp_path: Path) -> None:
    found = node('<shape type="sphere"><boolean name="flip_normals" value="yes"/></shape>', tmp_path)
    with pytest.raises(FiptError, match="flip_normals must be true or false; found 'yes'"):
        found.flag("flip_normals", False)


def node(text: str, tmp_path: Path) -> Node:
    path = tmp_path / "s.xml"
    path.write_text(f'<scene version="3.0.0">{text}</scene>')
    return read_tree(path).root.children[0]


TRANSFORMS = {
    "a rotation about nothing": ('<rotate angle="90"/>', "a rotation must have an axis"),
    "a matrix of a camera": ('<matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 5 1"/>', "last row of a transform must be 0"),
    "a look at where it stands": ('<lookat origin="1 1 1" target="1 1 1" up="0 1 0"/>', "the transform must be finite"),
    "a look along its up": ('<lookat origin="0 0 0" target="0 1 0" up="0 1 0"/>', "the transform must be finite"),
    "a scale of nan": ('<scale value="nan"/>', "the transform must be finite"),
    "three numbers of a matrix": ('<matrix value="1 0 0"/>', "a matrix must have 16 .or 9. numbers; found 3"),
}


@pytest.mark.parametrize("name", TRANSFORMS)
def test_a_transform_that_cannot_be(name: str, tmp_path: Path) -> None:
    text, said = TRANSFORMS[name]
    with pytest.raises(FiptError, match=f"s.xml line 1: .*{said}"):
        transform(node(f"<transform>{text}</transform>", tmp_path))


BALL = '<shape type="sphere">{}</shape>'
SHAPES = {
    "a sphere turned inside out": (
        BALL.format('<float name="radius" value="-1"/>'),
        "the radius of a s",
    ),
    "a sphere of no size": (
        BALL.format('<float name="radius" value="nan"/>'),
        "radius must be a number",
    ),
    "a sphere nowhere": (
        BALL.format('<point name="center" x="nan"/>'),
        "center must be finite",
    ),
    "a cylinder without length": (
        '<shape type="cylinder"><point name="p0" value="1 1 1"/><point name="p1" value="1 1 1"/></shape>',
        "the ends of a cylinder must be apart",
    ),
    "a disk beyond the stars": (
        '<shape type="disk"><transform name="to_world"><scale value="1e30"/></transform></shape>',
        "the vertices of a shape must lie within 1e.12",
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_that_cannot_be(name: str, tmp_path: Path) -> None:
    text, said = SHAPES[name]
    shape = node(text, tmp_path)
    with pytest.raises(FiptError, match=said):
        geometry(
            PlacedShape(shape, transform(shape.get("to_world")), "a"), SceneFileReader(tmp_path / "s.xml", SceneFile())
        )


def test_materials_beyond_one_are_told(tmp_path: Path, backend: Backend, caplog: pytest.LogCaptureFixture) -> None:
    source = SceneFileReader(tmp_path / "s.xml", SceneFile())
    bright = node('<bsdf type="diffuse"><rgb name="reflectance" value="5 5 5"/></bsdf>', tmp_path)
    material("a", converted(bright, source), 0.15)
    assert "material a: its base color reaches 5, which is taken as 0." in caplog.text
    rough = node('<bsdf type="roughconductor"><float name="alpha" value="9"/></bsdf>', tmp_path)
    material("b", converted(rough, source), 0.15)
    assert "material b: its roughness reaches 3, which is taken as 1" in caplog.text
    inner = '<bsdf type="diffuse"/><bsdf type="diffuse"/>'
    converted(node(f'<bsdf type="blendbsdf"><float name="weight" value="9"/>{inner}</bsdf>', tmp_path), source)
    assert "the weight of a blendbsdf reaches 9, more than 1" in caplog.text


def test_shapes_in_one_place_are_told(tmp_path: Path) -> None:
    """Whatever their winding and the order of their triangles; not those that only share a corner."""
    chair, cupboard = box((1, 0, 1), (1.5, 1, 1.5)), box((1.5, 0, 1.5), (2.5, 2, 2))
    turned = replace(chair, triangles=chair.triangles[::-1, [0, 2, 1]])
    mesh = joined(cupboard, chair, turned)
    names = ("cupboard", "chair", "chair-2")
    part = np.repeat([1, 2, 3], [len(each.triangles) for each in (cupboard, chair, turned)])
    assert doubled_parts(mesh, part, names) == [("chair", "chair-2", len(chair.triangles))]
