"""A scan in other coordinates, brought to views of a known room."""

import numpy as np
import pytest
import trimesh

from fipt.errors import FiptError
from fipt.render.scene import RayScene
from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh, write_ply
from fipt.stages.geometry import registration
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.mesh_settings import AutoGeometry
from fipt.stages.geometry.registration import registered
from fipt.stages.geometry.scan import from_scan
from tests.unit.stages.geometry.test_fusing import HALF, around

pytestmark = pytest.mark.usefixtures("open3d")


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    """An eighth of the points place a room as plain as this one."""
    monkeypatch.setattr(registration, "_POINTS", 1_000)


@pytest.fixture(scope="module")
def room() -> Mesh:
    """A room with a cupboard in a corner: it does not look alike from two sides."""
    place = trimesh.transformations.translation_matrix((0.9, -0.4, -1.4))
    parts = trimesh.creation.box((3.0, 1.8, 3.6)), trimesh.creation.box((1.2, 1.0, 0.8), place)
    both = trimesh.util.concatenate(parts)
    return Mesh(np.asarray(both.vertices, np.float32), np.asarray(both.faces, np.int32))


@pytest.fixture(scope="module")
def views(room, backend) -> list[DepthView]:
    """Views of the room, their depth exact."""
    scene = RayScene(room)
    found = []
    for view in around():
        rays = view.rays.reshape(-1, 3)
        length = np.linalg.norm(rays, axis=1)
        far, triangle = scene.intersect(view.camera.center, (rays / length[:, None]).astype(np.float32))
        normal = room.normals[triangle]
        normal *= -np.sign((normal * rays).sum(axis=1))[:, None]
        depth = np.where(triangle >= 0, far / length, 0).reshape(60, 80).astype(np.float32)
        found.append(view.with_map(DepthMap(depth, np.ones_like(depth), normal.reshape(60, 80, 3))))
    return found


def displaced(mesh: Mesh, degrees: float, shift: tuple[float, float, float], scale: float = 1.0) -> Mesh:
    turn = trimesh.transformations.rotation_matrix(np.radians(degrees), [0.3, 1.0, -0.2])[:3, :3]
    return Mesh((scale * (mesh.vertices @ turn.T + shift)).astype(np.float32), mesh.triangles)


def test_a_displaced_scan_is_brought_back(room, views):
    mesh, about = registered(displaced(room, 137.0, (4.0, -7.0, 2.5)), views)
    np.testing.assert_allclose(mesh.vertices, room.vertices, atol=0.02)
    assert about["share"] > 0.97
    assert about["residual_mm"] < 5
    assert about["turned"] == pytest.approx(137, abs=0.5)
    assert about["warnings"] == []


def scanned(views, path, unit, origin=(0.0, 0.0, 0.0)):
    shown = {view.camera.name: (view.radiance, np.ones(view.map.depth.shape, np.float32)) for view in views}
    return from_scan(views, path, shown.__getitem__, AutoGeometry(scan=str(path), scan_unit=unit), np.array(origin))


def test_a_scan_in_millimetres_is_refused_with_its_unit(tmp_path, room, views):
    write_ply(tmp_path / "scan.ply", displaced(room, 20.0, (0.1, 0.2, 0.3), 1000.0))
    with pytest.raises(FiptError, match=r"geometry\.scan_unit: 0\.001"):
        scanned(views, tmp_path / "scan.ply", 1.0)
    made = scanned(views, tmp_path / "scan.ply", 0.001)
    assert not made.about["prepared"]["prepared"]  # exact, and coarser than pixels
    np.testing.assert_allclose(made.mesh.vertices, room.vertices, atol=0.02)
    blue = (made.image[:, -80:] == (0, 90, 181)).all(axis=-1)
    assert blue.mean() > 0.97  # views and scan show the same depth


def test_the_unit_that_is_named_counts_from_the_one_that_is_set(tmp_path, room, views):
    write_ply(tmp_path / "scan.ply", displaced(room, 20.0, (0.1, 0.2, 0.3), 100.0))
    for unit in (0.001, 1.0):
        with pytest.raises(FiptError, match=r"geometry\.scan_unit: 0\.01,"):
            scanned(views, tmp_path / "scan.ply", unit)
    write_ply(tmp_path / "scan.ply", displaced(room, 20.0, (0.1, 0.2, 0.3)))
    with pytest.raises(FiptError, match=r"geometry\.scan_unit: 1,"):
        scanned(views, tmp_path / "scan.ply", 0.001)


def test_a_scan_in_coordinates_of_a_map_is_brought_back_to_millimetres(tmp_path, room, views):
    turn = trimesh.transformations.rotation_matrix(np.radians(137.0), [0.3, 1.0, -0.2])[:3, :3]
    far = room.vertices @ turn.T + (691_834.123, 5_334_567.891, 512.345)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in far]
    lines += [f"f {a} {b} {c}" for a, b, c in room.triangles + 1]
    (tmp_path / "scan.obj").write_text("\n".join(lines) + "\n")
    made = scanned(views, tmp_path / "scan.obj", 1.0)
    np.testing.assert_allclose(made.mesh.vertices, room.vertices, atol=0.005)
    placed = made.about["registration"]
    world_from_scan = np.array(placed["world_from_scan"])
    np.testing.assert_allclose(far @ world_from_scan[:3, :3].T + world_from_scan[:3, 3], room.vertices, atol=0.005)
    assert placed["moved"] == pytest.approx(np.linalg.norm((691_834, 5_334_568, 512)), abs=3)


def test_a_scan_in_the_coordinates_of_its_cameras_stays_where_it_is(tmp_path):
    """A cube looks alike from all sides: only where it lies already tells which of them is meant."""
    cube = trimesh.creation.box((2 * HALF, 2 * HALF, 2 * HALF)).subdivide().subdivide()
    origin = np.array([691_834.0, 5_334_567.0, 512.0])
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in cube.vertices + origin]
    lines += [f"f {a} {b} {c}" for a, b, c in cube.faces + 1]
    (tmp_path / "scan.obj").write_text("\n".join(lines) + "\n")
    placed = scanned(around(), tmp_path / "scan.obj", 1.0, origin).about["registration"]
    assert placed["turned"] < 0.1
    assert placed["moved"] < 0.01
    world_from_scan = np.array(placed["world_from_scan"])
    np.testing.assert_allclose(world_from_scan[:3, :3] @ origin + world_from_scan[:3, 3], np.zeros(3), atol=0.01)


def test_another_room_is_refused(views):
    other = trimesh.creation.cylinder(1.2, 3.0)
    with pytest.raises(FiptError, match="in its best place"):
        registered(Mesh(np.asarray(other.vertices, np.float32), np.asarray(other.faces, np.int32)), views)


def test_a_room_that_looks_alike_from_several_sides_is_told():
    cube = trimesh.creation.box((2 * HALF, 2 * HALF, 2 * HALF))
    _, about = registered(Mesh(np.asarray(cube.vertices, np.float32), np.asarray(cube.faces, np.int32)), around())
    assert "in another place" in about["warnings"][0]


def test_a_scan_without_a_surface_is_refused(views):
    line = Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(FiptError, match="all of its triangles are without area"):
        registered(line, views)
