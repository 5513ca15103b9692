"""Objects from files: their materials where they belong, and what is said of files that are none."""

import json
import struct

import numpy as np
import pytest
import trimesh

from fipt.errors import FiptError
from fipt.formats.glb import chunks, packed
from fipt.formats.images import srgb_decode
from fipt.render.objects import barycentric
from fipt.scene import objects
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.objects import bilinear, object_files, read_object, shape_object
from tests import scenes
from tests.objects import (
    BLUE,
    CORNERS,
    RED,
    UPRIGHT,
    WHITE,
    picture,
    write_cube_glb,
    write_obj,
    write_plain_glb,
    write_square_glb,
)


def look(thing, points):
    """Material of an object in z = 0 at points (x, y), found by brute force."""
    points = np.pad(np.float64(points), ((0, 0), (0, 1)))
    corners = thing.mesh.corners.astype(float)
    # the triangle in which all barycentric weights are positive, by the areas of its parts
    parts = [
        [np.cross(corners[:, (k + 1) % 3] - p, corners[:, (k + 2) % 3] - p)[:, 2] for k in range(3)] for p in points
    ]
    triangle = np.array([np.min(areas, axis=0).argmax() for areas in parts])
    return thing.at(triangle, barycentric(corners[triangle], points))


QUARTERS = [(-0.25, 0.25), (0.25, 0.25), (-0.25, -0.25), (0.25, -0.25)]
"""Middles of the picture's fields: upper left, upper right, lower left, lower right."""


@pytest.mark.parametrize("write", [write_square_glb, write_obj])
def test_a_texture_stands_upright(tmp_path, write):
    thing = read_object(write(tmp_path / f"square.{'glb' if write is write_square_glb else 'obj'}"))
    color, roughness, metallic = look(thing, QUARTERS)
    np.testing.assert_allclose(color, srgb_decode(np.array([RED, WHITE, WHITE, BLUE]) / 255), rtol=1e-5)
    if write is write_square_glb:
        np.testing.assert_allclose(roughness, 0.4, rtol=1e-5)
        np.testing.assert_allclose(metallic, 0.25, rtol=1e-5)
    else:
        assert not metallic.any(), "materials of an OBJ know no metal"


FIELDS = srgb_decode(np.array([RED, WHITE, WHITE, BLUE]) / 255)


def textured(**texture):
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}, "metallicFactor": 0}}


@pytest.mark.parametrize(("kind", "most"), [(np.uint16, 65535), (np.uint8, 255)])
def test_texture_coordinates_of_integers(tmp_path, kind, most):
    attributes = {"POSITION": CORNERS, "TEXCOORD_0": (UPRIGHT * most).astype(kind)}
    thing = read_object(write_plain_glb(tmp_path / "a.glb", attributes, textured()))
    np.testing.assert_allclose(look(thing, QUARTERS)[0], FIELDS, rtol=1e-5)


def test_positions_that_are_quantized(tmp_path):
    attributes = {"POSITION": (CORNERS * 32767).astype(np.int16), "TEXCOORD_0": UPRIGHT}
    thing = read_object(write_plain_glb(tmp_path / "a.glb", attributes, textured(), ["KHR_mesh_quantization"]))
    np.testing.assert_allclose(thing.mesh.vertices, CORNERS, atol=1e-4)


@pytest.mark.parametrize(("kind", "most"), [(np.float32, 1), (np.uint16, 65535), (np.uint8, 255)])
@pytest.mark.parametrize("with_material", [False, True])
def test_colours_of_vertices_times_the_base_colour(tmp_path, kind, most, with_material):
    colors = np.tile([0.6, 0.2, 0, 1], (4, 1)) * most
    maps = {"baseColorFactor": [1, 0.2, 1, 1], "roughnessFactor": 0.3, "metallicFactor": 0.25}
    material = {"pbrMetallicRoughness": maps} if with_material else None
    path = write_plain_glb(tmp_path / "a.glb", {"POSITION": CORNERS, "COLOR_0": colors.astype(kind)}, material)
    color, roughness, metallic = look(read_object(path), QUARTERS[:1])
    np.testing.assert_allclose(color, [[0.6, 0.04 if with_material else 0.2, 0]], atol=3e-3)
    np.testing.assert_allclose([*roughness, *metallic], [0.3, 0.25] if with_material else [0.6, 0], rtol=1e-5)


def test_colours_of_vertices_beside_a_texture_are_left_out(tmp_path, caplog):
    attributes = {"POSITION": CORNERS, "TEXCOORD_0": UPRIGHT, "COLOR_0": np.float32([[1, 1, 1]] * 4)}
    read_object(write_plain_glb(tmp_path / "white.glb", attributes, textured()))
    assert not caplog.text
    attributes["COLOR_0"] = attributes["COLOR_0"] / 2
    thing = read_object(write_plain_glb(tmp_path / "a.glb", attributes, textured()))
    np.testing.assert_allclose(look(thing, QUARTERS)[0], FIELDS, rtol=1e-5)
    assert "a.glb has colours of vertices beside a texture: these colours are left out" in caplog.text


def moved_by(**values):
    return textured(extensions={"KHR_texture_transform": values})


@pytest.mark.parametrize(
    ("material", "required", "said"),
    [
        (textured(texCoord=1), [], r"the material 'without a name' in .*a\.glb has a texture on its second texture"),
        (moved_by(texCoord=1), [], "has a texture on its second texture coordinates"),
        (moved_by(scale=[0.5, 0.5]), [], r"moves or scales a texture \(KHR_texture_transform\), which is not read"),
        (None, ["EXT_meshopt_compression"], "needs the glTF extension EXT_meshopt_compression, which is not read"),
    ],
)
def test_what_is_not_read_of_gltf(tmp_path, material, required, said):
    path = write_plain_glb(tmp_path / "a.glb", {"POSITION": CORNERS, "TEXCOORD_0": UPRIGHT}, material, required)
    with pytest.raises(FiptError, match=said) as caught:
        read_object(path)
    assert "\n" not in str(caught.value)


def test_a_transform_that_changes_nothing_is_taken(tmp_path):
    material, required = moved_by(scale=[1.0, 1.0], offset=[0, 0]), ["KHR_texture_transform", "KHR_materials_ior"]
    attributes = {"POSITION": CORNERS, "TEXCOORD_0": UPRIGHT}
    thing = read_object(write_plain_glb(tmp_path / "a.glb", attributes, material, required))
    np.testing.assert_allclose(look(thing, QUARTERS)[0], FIELDS, rtol=1e-5)


def test_numbers_in_other_files_are_refused(tmp_path):
    path = write_plain_glb(tmp_path / "a.glb", {"POSITION": CORNERS})
    document, binary = chunks(path.read_bytes())
    document["buffers"][0]["uri"] = "a.bin"
    path.write_bytes(packed(document, binary))
    with pytest.raises(FiptError, match="its numbers are not inside the file"):
        read_object(path)


def test_parts_share_the_maps_of_their_material(tmp_path):
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture(), roughnessFactor=0.4)
    scene = trimesh.Scene()
    for shift in range(3):
        visual = trimesh.visual.TextureVisuals(uv=UPRIGHT, material=material)
        part = trimesh.Trimesh(
            CORNERS + np.float32([2 * shift, 0, 0]), [[0, 1, 2], [0, 2, 3]], visual=visual, process=False
        )
        scene.add_geometry(part)
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    thing = read_object(tmp_path / "a.glb")
    assert len(thing.mesh.triangles) == 6
    assert len(thing.materials) == 1
    assert not thing.material.any()


def described_by(folder, lines, name="fields.png"):
    """The square of an OBJ file whose material has these lines; the picture has that name."""
    path = write_obj(folder / "a.obj")
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / "fields.png").rename(folder / name)
    (folder / "fields.mtl").write_text(f"newmtl a\n{lines}\n")
    return path


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("map_Kd -s 1.0 1.0 1 fields.png", "fields.png"),
        ("map_Kd -clamp on -o 0 0 0 fields.png", "fields.png"),
        ("map_Kd -bm 1 2 fields.png", "2 fields.png"),
        ("map_Kd -mm 0 1 my fields.png", "my fields.png"),
        ("map_kd fields.png", "fields.png"),
        ("map_Kd maps\\fields.png", "maps/fields.png"),
        ("map_Kd ../maps/fields.png", "../maps/fields.png"),
    ],
)
def test_textures_of_an_obj_behind_options_and_in_folders(tmp_path, caplog, line, name):
    folder = tmp_path / "object"
    folder.mkdir()
    path = described_by(folder, f"Kd 1 1 1\n{line}", name)
    np.testing.assert_allclose(look(read_object(path), QUARTERS)[0], FIELDS, rtol=1e-5)
    assert not caplog.text
    assert str(folder / name) in object_files(path)


@pytest.mark.parametrize(("lines", "gain"), [("map_Kd fields.png", 1), ("Kd 0.2 0.2 0.2\nmap_Kd fields.png", 0.2)])
def test_a_texture_is_times_kd_where_it_is_said(tmp_path, lines, gain):
    thing = read_object(described_by(tmp_path, lines))
    np.testing.assert_allclose(look(thing, QUARTERS)[0], gain * FIELDS, rtol=1e-5)


def test_a_material_without_colour_is_neutral(tmp_path):
    color, *_ = look(read_object(described_by(tmp_path, "Ns 10")), QUARTERS)
    np.testing.assert_allclose(color, 0.5)


def test_overrides_replace_what_they_name(tmp_path):
    thing = read_object(write_square_glb(tmp_path / "a.glb"))
    color, roughness, metallic = look(thing.changed(None, 0.9, None), QUARTERS)
    assert np.ptp(color, axis=0).max() > 0.3
    np.testing.assert_allclose(roughness, 0.9)
    np.testing.assert_allclose(metallic, 0.25, rtol=1e-5)
    color, *_ = look(thing.changed((0.1, 0.2, 0.3), None, None), QUARTERS)
    np.testing.assert_allclose(color, [[0.1, 0.2, 0.3]] * 4, rtol=1e-6)


def test_colours_of_vertices_are_linear_over_triangles(tmp_path, np_rng):
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0]])
    colors = np.uint8([[255, 0, 0], [0, 255, 0], [0, 0, 255], [40, 80, 120], [255, 255, 255]])
    write_ply(tmp_path / "a.ply", Mesh(corners, np.int32([[0, 1, 2], [1, 3, 2], [1, 4, 3]])), colors)
    thing = read_object(tmp_path / "a.ply")
    triangle = np.repeat([0, 1, 2], 20)
    weights = np_rng.dirichlet(np.ones(3), 60)
    own = np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3]])[triangle]
    expected = np.einsum("nk,nkc->nc", weights, srgb_decode(colors[own] / 255.0))
    np.testing.assert_allclose(thing.at(triangle, weights)[0], expected, atol=1e-5)


def test_colours_of_vertices_of_gltf_are_linear_light(tmp_path):
    import trimesh

    colors = np.tile(np.uint8([128, 64, 255, 255]), (3, 1))
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], vertex_colors=colors, process=False)
    (tmp_path / "a.glb").write_bytes(mesh.export(file_type="glb"))
    color, *_ = read_object(tmp_path / "a.glb").at(np.array([0]), np.full((1, 3), 1 / 3))
    np.testing.assert_allclose(color, [[128 / 255, 64 / 255, 1]], atol=3e-3)


def test_normals_and_places_that_are_no_numbers_are_left_out(tmp_path):
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "vn nan nan nan", "vn 0 0 1", "vt nan 0", "vt 1 inf"]
    lines.append("f 1/1/1 2/2/2 3/1/2")
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
    thing = read_object(tmp_path / "a.obj")
    assert np.isfinite(thing.normals).all()
    assert np.isfinite(thing.uv).all()
    assert np.isfinite(thing.at(np.array([0]), np.full((1, 3), 1 / 3))[0]).all()


def test_what_has_no_material_is_neutral_and_flat(tmp_path):
    write_ply(tmp_path / "a.ply", scenes.box((0, 0, 0), (1, 1, 1)))
    thing = read_object(tmp_path / "a.ply")
    assert not thing.normals.any()
    color, roughness, metallic = thing.at(np.array([3]), np.array([[0.2, 0.3, 0.5]]))
    np.testing.assert_allclose([*color[0], *roughness, *metallic], [0.5, 0.5, 0.5, 0.6, 0], rtol=1e-6)


def test_nodes_of_a_scene_are_placed_with_their_normals(tmp_path):
    ball = trimesh.creation.icosphere(1)
    ball = trimesh.Trimesh(ball.vertices, ball.faces, vertex_normals=ball.vertices, process=False)
    placed = trimesh.transformations.rotation_matrix(1.0, [1, 1, 0])
    placed[:3, 3] = [1, 2, 3]
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=placed)
    scene.add_geometry(ball.copy(), transform=trimesh.transformations.translation_matrix([-2, 0, 0]))
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb", include_normals=True))
    thing = read_object(tmp_path / "a.glb")
    assert len(thing.mesh.triangles) == 160
    center = np.where(thing.mesh.vertices[:, :1] > -1, [[1.0, 2, 3]], [[-2.0, 0, 0]])
    np.testing.assert_allclose(thing.normals, thing.mesh.vertices - center, atol=1e-5)


def test_maps_repeat_and_are_bilinear():
    image = np.float32([[[0], [1]], [[2], [3]]])
    uv = np.array([[0.25, 0.25], [0.75, 0.25], [0.5, 0.25], [0.5, 0.5], [1.25, -0.25], [0.0, 0.25]])
    np.testing.assert_allclose(bilinear(image, uv)[:, 0], [0, 1, 0.5, 1.5, 2, 0.5])


def test_shapes():
    ball, cube = shape_object("sphere", 0.4), shape_object("cube", 0.3)
    np.testing.assert_allclose(np.linalg.norm(ball.mesh.vertices, axis=1), 0.2, rtol=1e-5)
    np.testing.assert_allclose(ball.normals, ball.mesh.vertices / 0.2, atol=1e-5)
    assert cube.mesh.areas.sum() == pytest.approx(6 * 0.09, rel=1e-5)
    for thing in (ball, cube):  # outwards
        assert (np.einsum("tc,tc->t", thing.mesh.normals, thing.mesh.corners.mean(axis=1)) > 0).all()


def test_files_that_an_object_refers_to(tmp_path):
    names = [path.rpartition("/")[2] for path in object_files(write_obj(tmp_path / "a.obj"))]
    assert names == ["a.obj", "fields.mtl", "fields.png"]
    assert object_files("nowhere.obj") == ["nowhere.obj"]


def broken_glb(path, kind):
    """A cube whose picture is of another kind than it should be."""
    content = write_cube_glb(path).read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + length])
    image = document["images"][0]
    if kind == "outside":
        del image["bufferView"]
        image["uri"] = "wood.png"
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        rest = content[20 + length :]
        return path.write_bytes(
            struct.pack("<4s4I", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
        )
    view = document["bufferViews"][image["bufferView"]]
    start = 20 + length + 8 + view.get("byteOffset", 0)
    return path.write_bytes(content[:start] + b"\xabKTX 20\xbb" + content[start + 8 :])


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.ply", None, "an object's file is missing"),
        ("a.ply", b"hello", r"a\.ply is not a readable mesh"),
        ("a.obj", b"hello", r"a\.obj holds no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "1 vertices that are NaN, infinite"),
        ("a.glb", b"hello", r"a\.glb is not a readable mesh"),
        ("a.stl", b"solid", "must be a PLY, OBJ or GLB file"),
        ("a.glb", "ktx", r"the image '?.*cannot be read; export the file with PNG or JPEG textures inside"),
        ("a.glb", "outside", r"the image 'wood\.png' .*cannot be read"),
    ],
)
def test_files_that_cannot_be_objects(tmp_path, name, content, said):
    if isinstance(content, bytes):
        (tmp_path / name).write_bytes(content)
    elif content:
        broken_glb(tmp_path / name, content)
    with pytest.raises(FiptError, match=said) as caught:
        read_object(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_large_objects_are_taken_with_a_warning(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(objects, "MANY", 10)
    write_ply(tmp_path / "a.ply", scenes.box((0, 0, 0), (1, 1, 1)))
    assert len(read_object(tmp_path / "a.ply").mesh.triangles) == 12
    assert "has 12 triangles; fewer would be faster" in caplog.text
