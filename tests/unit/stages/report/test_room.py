"""The model of the 3D view: a glTF file that other programs read, with the colours of what was seen."""

import base64
import io
import json
import struct
import zlib

import numpy as np
import pytest
import trimesh

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh
from fipt.stages.report import room
from fipt.stages.report.content import gather
from fipt.stages.report.selection import Selection
from fipt.stages.report.settings import ReportSettings
from tests import scenes
from tests.fake_results import write_results

BOX = scenes.box((0, 0, 0), (4, 3, 5))


def loaded(content):
    return trimesh.load(io.BytesIO(content), file_type="glb", process=False, force="mesh")


def vertex_colors(content):
    """(V, 3) linear colours; trimesh takes the lower 8 of their 16 bits."""
    (length,) = struct.unpack_from("<I", content, 12)
    view = json.loads(content[20 : 20 + length])["bufferViews"][1]
    start = 28 + length + view["byteOffset"]
    return np.frombuffer(content[start : start + view["byteLength"]], "<u2").reshape(-1, 4)[:, :3] / 65535


def test_vertices_have_the_colour_of_what_was_seen_nearby(np_rng):
    """Red for x below 2, green above."""
    places = np_rng.uniform((0, 0, 0), (4, 3, 5), (20000, 3))
    colors = np.where(places[:, :1] < 2, [[0.8, 0, 0]], [[0, 0.4, 0]])
    content = room.colored(BOX, places, colors)
    mesh = loaded(content)
    assert mesh.area == pytest.approx(BOX.areas.sum(), rel=1e-5)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [4, 3, 5]], atol=1e-6)
    shown = vertex_colors(content)
    left, right = mesh.vertices[:, 0] < 1.5, mesh.vertices[:, 0] > 2.5
    assert left.sum() > 100
    np.testing.assert_allclose(shown[left], np.broadcast_to([0.8, 0, 0], (left.sum(), 3)), atol=1e-4)
    np.testing.assert_allclose(shown[right], np.broadcast_to([0, 0.4, 0], (right.sum(), 3)), atol=1e-4)


def test_large_triangles_are_cut_and_very_many_are_thinned(monkeypatch):
    monkeypatch.setattr(room, "_TRIANGLES", 400)
    vertices, triangles = room._cut(BOX)
    areas = Mesh(vertices, triangles).areas
    assert areas.max() <= 4 * BOX.areas.sum() / 400
    assert len(triangles) <= 412
    assert areas.sum() == pytest.approx(BOX.areas.sum(), rel=1e-6)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    monkeypatch.setattr(room, "_MOST", 5000)
    ball = trimesh.creation.icosphere(5, 1.0)
    vertices, triangles = room._cut(Mesh(np.float32(ball.vertices), np.int32(ball.faces)))
    assert 100 < len(triangles) < 2000
    assert Mesh(vertices, triangles).areas.sum() == pytest.approx(ball.area, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1, atol=1e-5)


def test_up_is_the_axis_nearest_to_the_cameras(tmp_path):
    root = write_results(tmp_path)
    cameras = [scenes.look_at(name, (0, 0, 2), (3, 1, 1)) for name in "abc"]
    lying = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # y up becomes z up
    for camera in cameras:
        camera.world_from_camera[:] = lying @ camera.world_from_camera
    write_transforms(root / "dataset" / "transforms.json", cameras)
    found = room.read_room(root, Dataset(root / "dataset"), [])
    assert found.up == [0, 0, 1]
    place = found.viewpoints[0]
    np.testing.assert_allclose(place.eye, cameras[0].center)
    np.testing.assert_allclose(place.forward, lying[:3, :3] @ (np.array([3, 1, -1]) / np.sqrt(11)), atol=1e-9)


def exported(root, turn, size=0):
    write_text(root / "export" / "export.json", json.dumps({"room_from_source": turn}))
    content = b"glTF" + bytes(size)
    (root / "export" / "scene.glb").write_bytes(content)
    return content


def test_the_exported_scene_is_shown_where_there_is_one(tmp_path, monkeypatch):
    root = write_results(tmp_path)
    assert not gather(root, ReportSettings()).room.exported
    turn = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    content = exported(root, turn)
    lamp = {"index": 4, "name": "window", "color": "#fff", "center": [1, 2, 3]}
    found = room.read_room(root, Dataset(root / "dataset"), [lamp])
    assert found.exported
    assert zlib.decompress(base64.b64decode(found.model)) == content
    assert found.emitters[0].center == [1, 3, -2]
    monkeypatch.setattr(room, "_LARGEST", 3)  # too large for a page: the coloured mesh instead
    assert not gather(root, ReportSettings()).room.exported


def test_an_export_of_an_earlier_plan_is_not_shown(tmp_path):
    root = write_results(tmp_path)
    exported(root, [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    write_text(root / "export" / "check.json", "damaged")
    found = gather(root, ReportSettings(), Selection(sections=["poses"]))
    assert not found.room.exported
    assert found.export is None


def test_an_export_must_say_how_it_was_turned(tmp_path):
    root = write_results(tmp_path)
    exported(root, [1, 2])
    with pytest.raises(FiptError, match=r"export\.json does not say how the export was turned"):
        gather(root, ReportSettings())


def test_without_material_maps_there_is_no_room(tmp_path):
    root = write_results(tmp_path)
    for path in (root / "materials").iterdir():
        path.unlink()
    assert gather(root, ReportSettings()).room is None
