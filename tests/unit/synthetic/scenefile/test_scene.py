"""Whole scene files: surfaces, materials, lights, and what is said about bad ones."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.synthetic.settings import SceneFile

OBJ = "v 1 0 1\nv 1.5 0 1\nv 1.5 0.5 1\nv 1 0.5 1\n"
OBJ += "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1/1 1/1 2/2\n"


def read(path, **settings):
    from fipt.synthetic.scenefile.scene import read_scene

    return read_scene(path, SceneFile(**settings))


def picture(path) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(np.full((8, 8, 3), 128, np.uint8)).save(path)


def test_a_room(write_scene, tmp_path, backend):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "Chair.obj").write_text(OBJ)
    picture(tmp_path / "textures" / "wood.png")
    path = write_scene(
        """<bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="no-such-bump.png"/></texture>
             <bsdf type="twosided" id="Wood"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
             <string name="filename" value="textures/wood.png"/></texture></bsdf></bsdf></bsdf>
           <bsdf type="dielectric" id="Glass"/>
           <shape type="obj"><string name="filename" value="models/Chair.obj"/><ref id="Wood"/></shape>
           <shape type="obj"><string name="filename" value="models/Chair.obj"/><ref id="Wood"/>
             <transform name="to_world"><translate z="0.5"/></transform></shape>
           <shape type="cube" id="pane"><ref id="Glass"/></shape>"""
    )
    content = read(path)
    assert [s.name for s in content.surfaces] == ["walls", "lamp", "Chair", "Chair-2"]
    assert [m.name for m in content.materials] == ["Wall", "default", "Wood"]
    assert [s.material for s in content.surfaces] == [0, 1, 2, 2]
    chair = content.surfaces[2]
    assert chair.triangles.shape == (2, 3)
    assert chair.triangles.dtype == np.int32
    assert chair.vertices.dtype == chair.uv.dtype == np.float32
    assert chair.uv.min() == 0
    assert chair.uv.max() == 1
    lamp = content.surfaces[1]
    assert lamp.radiance.tolist() == [5, 4, 3]
    a, b, c = lamp.vertices[lamp.triangles[0]]
    assert np.cross(b - a, c - a)[1] < 0  # a rectangle shines along its normal: down
    assert np.allclose(content.box, [[0, 0, 0], [4, 2.5, 3]], atol=0.15)
    assert not content.environment.known
    assert content.files == [path, tmp_path / "models" / "Chair.obj", tmp_path / "textures" / "wood.png"]
    text = "\n".join(content.notes)
    for said in (
        "material Wall: diffuse; base colour 0.6, 0.5, 0.4; roughness 0.9; metallic 0",
        "material Wood: diffuse; base colour wood.png (0.216, 0.216, 0.216 in the mean)",
        "dropped 1 shapes of Glass (dielectric)",
        "dropped 2 degenerate triangles",
        "bsdf Wood: the bumpmap is ignored",
        "shape lamp: has no bsdf",
    ):
        assert said in text


def test_scene_files_lists_without_loading(write_scene, tmp_path):
    from fipt.synthetic.scenefile.scene import scene_files

    (tmp_path / "a.obj").write_text("this is never parsed")
    path = write_scene(
        '<shape type="obj"><string name="filename" value="a.obj"/></shape>'
        '<shape type="obj"><string name="filename" value="gone.obj"/></shape>'
        '<shape type="obj"><string name="filename" value="/etc/hostname"/></shape>'
    )
    assert scene_files(path) == [path, tmp_path / "a.obj"]


MISSING = """<shape type="obj"><string name="filename" value="models/a.obj"/></shape>
<shape type="ply"><string name="filename" value="models/b.ply"/></shape>
<shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="2" y="0.3" z="1.5"/></transform>
<bsdf type="diffuse" id="Cloth"><texture type="bitmap" name="reflectance"><string name="filename" value="t/c.png"/>
</texture></bsdf></shape>"""


def test_all_missing_files_are_listed_at_once_or_replaced(write_scene, backend):
    path = write_scene(MISSING)
    with pytest.raises(
        FiptError, match=r"3 files are missing: models/a.obj, models/b.ply, t/c.png.*allow_missing: true"
    ):
        read(path)
    content = read(path, allow_missing=True)
    cloth = content.materials[-1]
    assert cloth.flagged
    assert cloth.base_color.tolist() == [[[0.5, 0.5, 0.5]]]
    assert not content.materials[0].flagged
    assert len(content.surfaces) == 3
    assert any("material Cloth" in note and "FLAGGED" in note for note in content.notes)
    assert any("3 files are missing: models/a.obj" in note for note in content.notes)


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ('<shape type="heightfield"/>', "shape heightfield"),
        ('<shape type="cube"><bsdf type="velvet"/></shape>', "bsdf velvet"),
        ('<emitter type="laser"/>', "emitter laser"),
        (
            '<shape type="cube"><bsdf type="diffuse"><texture type="clouds" name="reflectance"/></bsdf></shape>',
            "texture clouds",
        ),
    ],
)
def test_unknown_plugins(body, what, write_scene, backend):
    path = write_scene(body)
    with pytest.raises(FiptError, match=rf"1 unknown: {what} \(scene.xml line 1\d\)"):
        read(path)
    assert any(what in note for note in read(path, allow_missing=True).notes)


@pytest.mark.parametrize("allow", [False, True])
def test_files_outside_the_folder_are_refused_always(allow, write_scene, backend):
    path = write_scene('<shape type="obj"><string name="filename" value="../../etc/a.obj"/></shape>')
    with pytest.raises(FiptError, match=r"refers outside its own folder, which is refused: \.\./\.\./etc/a.obj"):
        read(path, allow_missing=allow)


def test_a_damaged_mesh_is_named(write_scene, tmp_path, backend):
    (tmp_path / "m.obj").write_text("v 0 0 nonsense\nf 1 2 3\n")
    path = write_scene('<shape type="obj"><string name="filename" value="m.obj"/></shape>')
    with pytest.raises(FiptError, match=r"mesh m\.obj, which cannot be read"):
        read(path)


def test_no_light_and_no_surfaces(write_scene, backend):
    from tests.unit.synthetic.scenefile.conftest import WALLS

    dark = WALLS[: WALLS.index('<shape type="rectangle"')] + WALLS[WALLS.index("<sensor") :]
    with pytest.raises(FiptError, match="has no light"):
        read(write_scene("", walls=dark))
    sky = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    with pytest.raises(FiptError, match="has no light"):
        read(write_scene(sky, walls=dark), environment="drop")
    assert read(write_scene(sky, walls=dark)).environment.mode == "constant"
    with pytest.raises(FiptError, match="has no surfaces"):
        read(write_scene(sky, walls=""))


def test_z_up_is_turned_and_odd_units_become_metres(write_scene, backend):
    from tests.unit.synthetic.scenefile.conftest import WALLS

    turned = WALLS.replace("</transform>\n  <ref", '<rotate x="1" angle="90"/><scale value="10"/></transform>\n  <ref')
    turned = turned.replace(
        "</transform>\n  <emitter", '<rotate x="1" angle="90"/><scale value="10"/></transform>\n  <emitter'
    ).replace('origin="0.5 1.2 1.5" target="3 1.2 1.5" up="0 1 0"', 'origin="5 -15 12" target="30 -15 12" up="0 0 1"')
    content = read(write_scene("", walls=turned))
    assert np.allclose(np.ptp(content.box, axis=0), np.array([4, 2.5, 3]) * 2.7 / 2.5, rtol=0.06)
    lamp = content.surfaces[1].vertices
    assert np.ptp(lamp[:, 1]) < 1e-4
    assert lamp[0, 1] == pytest.approx(content.box[1, 1] * 2.4 / 2.5, rel=0.05)
    assert any("z is up" in note for note in content.notes)
    assert any("units high" in note for note in content.notes)
    assert np.ptp(read(write_scene("", walls=turned), scale=0.1).box[:, 1]) == pytest.approx(2.5, rel=0.05)


def test_quads_replace_the_light_from_outside(write_scene, backend):
    # A wall of the box is replaced by one with a hole: five sides and a frame of rectangles.
    sides = [
        ("2 1.5 1", "x", 90, "2 0 1.5"), ("2 1.5 1", "x", -90, "2 2.5 1.5"), ("2 1.25 1", "y", 0, "2 1.25 0"),
        ("2 1.25 1", "y", 180, "2 1.25 3"), ("1.5 1.25 1", "y", 90, "4 1.25 1.5"),
        ("1.5 0.4 1", "y", 90, "0 0.4 1.5"), ("1.5 0.35 1", "y", 90, "0 2.15 1.5"),
        ("0.45 0.5 1", "y", 90, "0 1.3 0.45"), ("0.45 0.5 1", "y", 90, "0 1.3 2.55"),
    ]  # fmt: skip
    walls = "".join(
        f'<shape type="rectangle"><transform name="to_world"><scale value="{size}"/>'
        f'<rotate {axis}="1" angle="{angle}"/>'
        f'<translate value="{place}"/></transform></shape>'
        for size, axis, angle, place in sides
    )
    path = write_scene('<emitter type="constant"><rgb name="radiance" value="2 3 4"/></emitter>', walls=walls)
    content = read(path, environment="quads")
    assert not content.environment.known
    quad = content.surfaces[-1]
    assert quad.name == "opening-0"
    assert len(content.surfaces) == len(sides) + 1
    assert np.allclose(quad.radiance, [2, 3, 4], rtol=0.01)
    a, b, c = quad.vertices[quad.triangles[0]]
    assert np.cross(b - a, c - a)[0] > 0
    assert any(note.startswith("opening at") for note in content.notes)


def test_a_mask_is_cut_and_an_instance_stands_where_it_is_put(write_scene, tmp_path, backend):
    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[:, :8] = 255
    Image.fromarray(pixels).save(tmp_path / "leaf.png")
    path = write_scene(
        """<bsdf type="mask" id="Leaf"><texture name="opacity" type="bitmap">
             <string name="filename" value="leaf.png"/></texture>
             <bsdf type="diffuse"/></bsdf>
           <shape type="shapegroup" id="plant"><shape type="rectangle"><ref id="Leaf"/></shape></shape>
           <shape type="instance" id="p"><ref id="plant"/>
             <transform name="to_world"><scale value="0.5"/><translate x="2" y="1" z="1"/></transform></shape>"""
    )
    leaf = read(path).surfaces[-1]
    assert leaf.name == "p/rectangle"
    assert leaf.vertices.min(axis=0) == pytest.approx([1.5, 0.5, 1])
    assert leaf.vertices[:, 0].max() == pytest.approx(2, abs=0.13)


def test_shapes_that_say_the_same_share_a_material(write_scene, backend):
    quad = """<shape type="rectangle">
      <transform name="to_world"><scale value="0.2"/><translate x="{}" y="1" z="1"/></transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="{}"/></bsdf></shape>"""
    named = '<bsdf type="plastic" id="P"/><shape type="cube" id="c"><ref name="bsdf" id="P"/>'
    named += '<transform name="to_world"><scale value="0.1"/><translate x="2" y="1" z="2"/></transform></shape>'
    content = read(write_scene(quad.format(1, 0.3) + quad.format(2, 0.3) + quad.format(3, 0.4) + named))
    used = [surface.material for surface in content.surfaces]
    assert used == [0, 1, 2, 2, 3, 4]
    names = ["Wall", "default", "of rectangle-2", "of rectangle-4", "P"]
    assert [material.name for material in content.materials] == names


def test_a_path_from_where_one_stands(write_scene, tmp_path, backend, monkeypatch):
    (tmp_path / "m.obj").write_text(OBJ)
    path = write_scene('<shape type="obj"><string name="filename" value="m.obj"/></shape>')
    monkeypatch.chdir(tmp_path)
    content = read(path.name)
    assert len(content.surfaces) == 3
    assert [str(file) for file in content.files] == ["scene.xml", "m.obj"]


def test_the_same_file_gives_the_same_room(write_scene, tmp_path, backend):
    sky = np.random.default_rng(0).random((32, 64, 3)).astype(np.float32)
    write_exr(tmp_path / "sky.exr", {"": sky})
    path = write_scene('<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>')
    first, second = read(path), read(path)
    assert first.notes == second.notes
    assert np.array_equal(first.box, second.box)
    for a, b in zip(first.surfaces, second.surfaces, strict=True):
        assert np.array_equal(a.vertices, b.vertices)
        assert np.array_equal(a.triangles, b.triangles)


def test_the_living_room_converts_as_its_dataset_did(living_room, backend):
    content = read(living_room / "scene" / "scene.xml", environment="quads")
    known = {
        entry["name"]: entry for entry in json.loads((living_room / "dataset" / "meta.json").read_text())["materials"]
    }
    made = {material.name: material for material in content.materials if material.name != "light"}
    assert made.keys() == known.keys()
    for name, material in made.items():
        assert material.roughness.mean() == pytest.approx(known[name]["rough"], abs=1e-3), name
        assert material.metallic.mean() == known[name]["metal"], name
        if not isinstance(known[name]["base"], str):
            assert np.allclose(material.base_color[0, 0], known[name]["base"], atol=1e-3), name
    quads = [s.vertices for s in content.surfaces if s.name.startswith("opening")]
    windows = json.loads((living_room / "dataset" / "meta.json").read_text())["windows"]
    centers = np.array([quad.mean(axis=0) for quad in quads])
    assert len(quads) == len(windows)
    for window in windows:
        assert np.linalg.norm(centers - window["centre"], axis=1).min() < 0.2
