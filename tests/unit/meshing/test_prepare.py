"""Meshes made fit for the pipeline: noise and planes found, a modeller's mesh left alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.meshing.clean import clean
from fipt.meshing.denoise import filtered_normals, fitted_to_normals, normal_deviation
from fipt.meshing.planes import find_planes, flattened, grown
from fipt.meshing.prepare import prepared
from fipt.meshing.topology import border_vertices
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh, surface_points
from fipt.synthetic.room import build
from fipt.synthetic.rooms import ROOMS
from tests.scenes import box, joined, quad, sheet

BOX = box((0, 0, 0), (2, 2, 2))
AUTO = SimpleNamespace(prepare="auto", triangle_size=1.0, cut_edges=True)


def scan(noise: float, count: int = 50) -> Mesh:
    """The inside of a corner of a room, three walls of 2 m welded together, with noise in metres."""
    x, y, z = 2 * np.eye(3)
    mesh, _ = clean(joined(*(sheet((0, 0, 0), u, v, count) for u, v in ((x, y), (y, z), (z, x)))), 0.0)
    moved = mesh.vertices + np.random.default_rng(0).normal(0, noise, mesh.vertices.shape)
    return Mesh(moved.astype(np.float32), mesh.triangles)


def camera(width: int = 40) -> Camera:
    """A view into the corner at the origin, from 3 m."""
    back = np.ones(3) / np.sqrt(3)
    right = np.cross([0, 0, 1], back) / np.linalg.norm(np.cross([0, 0, 1], back))
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, 3 * back], 1)
    return Camera("view", "train", width, width, width, width, width / 2, width / 2, pose)


def inside() -> Camera:
    """A wide view from the middle of the room."""
    pose = np.eye(4)
    pose[:3, 3] = 1
    return Camera("view", "train", 40, 40, 15, 15, 20, 20, pose)


def dark(view: str) -> tuple[np.ndarray, np.ndarray]:
    """A view without any edge."""
    return np.ones((40, 40, 3)), np.ones((40, 40))


def off_plane(mesh: Mesh) -> np.ndarray:
    """(T,) degrees between each triangle's normal and the nearest axis."""
    return np.degrees(np.arccos(np.clip(np.abs(mesh.normals).max(axis=1), 0, 1)))


@pytest.mark.parametrize("mesh", [BOX, joined(BOX, quad((1, 1, 1), (0.5, 0, 0), (0, 0.5, 0)))])
def test_a_modellers_mesh_is_not_touched(backend, mesh) -> None:
    done, figures = prepared(mesh, [camera()], dark, AUTO)
    assert done is mesh
    assert not figures["prepared"]


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_in_code_is_not_touched(backend, name) -> None:
    room = build(0, name=name)
    cameras = []
    for number, turn in enumerate((0.3, 1.9, 3.5, 5.1)):
        pose = np.eye(4)
        pose[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        pose[:3, 3] = room.box.mean(axis=0)
        cameras.append(Camera(f"view_{number}", "train", 80, 60, 50, 50, 40, 30, pose))
    assert prepared(room.mesh, cameras, dark, AUTO)[0] is room.mesh


def test_a_mesh_that_no_view_sees_is_not_touched(backend) -> None:
    mesh = Mesh(scan(0.004).vertices + np.float32(100), scan(0.004).triangles)
    done, figures = prepared(mesh, [camera()], dark, AUTO)
    assert done is mesh
    assert not figures["prepared"]


def test_a_noisy_corner_becomes_three_planes_and_a_sharp_corner(backend) -> None:
    mesh = scan(0.004)
    assert np.median(off_plane(mesh)) > 3
    done, figures = prepared(mesh, [camera()], dark, AUTO)
    assert figures["prepared"]
    assert figures["planes"] == 3
    assert len(done.triangles) < 0.2 * len(mesh.triangles)
    assert np.average(off_plane(done) < 0.3, weights=done.areas) > 0.98
    assert np.linalg.norm(done.vertices, axis=1).min() < 0.02  # the corner itself: half a side
    assert done.areas.sum() == pytest.approx(12, rel=0.02)


def test_a_wall_is_a_plane_where_few_depths_were_averaged_too(backend) -> None:
    """Noise of one end is six times that of the room; a hump that is higher than noise stays."""
    mesh = scan(0.001)
    rng, (x, y, z) = np.random.default_rng(1), mesh.vertices.T
    far, bump = (x > 1.2) & (y < 0.1), np.hypot(z - 0.6, y - 0.6) < 0.3
    moved = mesh.vertices + np.outer(far, [0, 1, 0]) * rng.normal(0, 0.006, (len(x), 1))
    moved[bump & (x < 0.1), 0] += 0.02 * np.cos(np.hypot(z - 0.6, y - 0.6) / 0.3 * np.pi / 2)[bump & (x < 0.1)]
    done, _ = prepared(Mesh(moved.astype(np.float32), mesh.triangles), [camera()], dark, AUTO)
    centers = done.corners.mean(axis=1)
    noisy = (centers[:, 0] > 1.3) & (centers[:, 1] < 0.03)
    assert np.average(off_plane(done)[noisy] < 0.5, weights=done.areas[noisy]) > 0.95
    assert done.vertices[np.linalg.norm(done.vertices - [0, 0.6, 0.6], axis=1) < 0.1, 0].max() > 0.015


def test_a_mesh_without_any_noise_has_its_planes(backend) -> None:
    """Deviations of exactly zero are the width of no filter."""
    done, figures = prepared(scan(0.0), [camera()], dark, SimpleNamespace(**vars(AUTO) | {"prepare": "always"}))
    assert figures["planes"] == 3
    assert "side_mm" not in figures, "it is no scan"
    assert np.isfinite(done.vertices).all()


def test_measured_noise_is_that_of_the_vertices(backend) -> None:
    one, other = (prepared(scan(noise), [camera()], dark, AUTO)[1] for noise in (0.002, 0.004))
    assert 1 < one["noise_mm"] < 4
    assert other["noise_mm"] == pytest.approx(2 * one["noise_mm"], rel=0.2)
    sides = np.linalg.norm(np.diff(scan(0.0).corners, axis=1), axis=2)
    assert one["side_mm"] == pytest.approx(1e3 * np.median(sides), rel=0.3)


def test_noise_is_measured_where_triangles_have_vertices_of_their_own(backend) -> None:
    welded = scan(0.004)
    loose = Mesh(welded.corners.reshape(-1, 3), np.arange(welded.triangles.size, dtype=np.int32).reshape(-1, 3))
    np.testing.assert_allclose(normal_deviation(loose), normal_deviation(welded), atol=1e-6)
    assert prepared(loose, [camera(20)], dark, AUTO)[1]["prepared"]


def test_shallow_furniture_keeps_its_step() -> None:
    wall = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 60)
    board = (np.abs(wall.vertices[:, :2] - 1) < 0.4).all(axis=1)
    noise = np.random.default_rng(0).normal(0, 0.001, wall.vertices.shape)
    mesh = Mesh((wall.vertices + noise + np.outer(board, [0, 0, 0.012])).astype(np.float32), wall.triangles)
    smooth = fitted_to_normals(mesh, filtered_normals(mesh, 0.2, 20), 20)
    planes = find_planes(smooth, np.radians(6), 0.003, 0.1)
    flat = flattened(smooth, grown(smooth, planes, 0.01, 2), 0.05)
    height = flat.vertices[:, 2]
    inner = (np.abs(wall.vertices[:, :2] - 1) < 0.3).all(axis=1)
    outer = (np.abs(wall.vertices[:, :2] - 1) > 0.5).any(axis=1)
    assert np.abs(height[inner] - 0.012).max() < 0.001
    assert np.abs(height[outer]).max() < 0.001


def test_two_sheets_ten_centimetres_apart_stay_apart(backend) -> None:
    wall = joined(sheet((0, 0, 0), (0, 2, 0), (0, 0, 2), 60), sheet((-0.1, 0, 0), (0, 0, 2), (0, 2, 0), 60))
    noise = np.random.default_rng(0).normal(0, 0.004, wall.vertices.shape)
    done, figures = prepared(Mesh((wall.vertices + noise).astype(np.float32), wall.triangles), [camera()], dark, AUTO)
    assert figures["prepared"]
    x = done.vertices[:, 0]
    assert ((np.abs(x) < 0.004) | (np.abs(x + 0.1) < 0.004)).all()
    corners = x[done.triangles]
    assert np.ptp(corners, axis=1).max() < 0.01  # no triangle leads across
    assert (done.normals[corners.mean(axis=1) > -0.05, 0] > 0.9).all()


def test_floaters_go_unless_a_view_needs_them() -> None:
    wall, crumb = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 4), quad((1, 1, 1), (0.1, 0, 0), (0, 0.1, 0))
    mesh = joined(wall, crumb, crumb)
    done, figures = clean(mesh, 0.05)
    assert (len(done.triangles), figures.duplicate, figures.floaters, figures.floater_triangles) == (32, 2, 1, 2)
    needed = np.zeros(36, bool)
    needed[32] = True
    assert len(clean(mesh, 0.05, needed)[0].triangles) == 34


def test_triangles_without_area_go() -> None:
    wall = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 4)
    mesh = Mesh(wall.vertices, np.concatenate([wall.triangles, [[0, 1, 1], [0, 1, 2]]]).astype(np.int32))
    done, figures = clean(mesh, 0.0)
    assert (len(done.triangles), figures.degenerate) == (32, 2)


def test_creases_are_no_noise() -> None:
    assert normal_deviation(BOX).max() < 1e-6


def test_a_prepared_room_leaks_no_light(backend) -> None:
    """Rays that start on its surface, as far off it as the tracer's, meet another wall, never their own or nothing."""
    x, y, z = 2 * np.eye(3)
    walls = [sheet((0, 0, 0), u, v, 40) for u, v in ((x, y), (y, z), (z, x))]
    walls += [sheet((2, 2, 2), -u, -v, 40) for u, v in ((y, x), (z, y), (x, z))]
    mesh, _ = clean(joined(*walls), 0.0)
    moved = mesh.vertices + np.random.default_rng(0).normal(0, 0.004, mesh.vertices.shape)
    done, figures = prepared(Mesh(moved.astype(np.float32), mesh.triangles), [inside()], dark, AUTO)
    assert figures["planes"] == 6
    assert not border_vertices(done).any()
    scene, middle = RayScene(done), np.array([1.0, 1.0, 1.0])
    rng = np.random.default_rng(1)
    points, triangle = surface_points(done, 0.05, np.full(3, -1.0), np.full(3, 3.0), 0)
    normals = done.normals[triangle]
    normals = np.where(((middle - points) * normals).sum(axis=1, keepdims=True) < 0, -normals, normals)
    directions = rng.normal(size=points.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.where((directions * normals).sum(axis=1, keepdims=True) < 0, -directions, directions)
    distance, met = scene.intersect(points + normals * scene.epsilon, directions.astype(np.float32))
    # the corners of a room are round by no more than its noise
    inner = (np.abs(points - 1) < 0.98).sum(axis=1) >= 2
    steep = (directions * normals).sum(axis=1) > 0.1
    assert (met[inner] >= 0).all()
    assert distance[inner & steep].min() > 0.001
