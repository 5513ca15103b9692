"""Depth maps of a known room, fused into one mesh."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.cameras import Camera
from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView, depth_noise
from fipt.stages.geometry.fusing import check_memory, fuse, voxel_size
from fipt.stages.geometry.mesh_settings import AutoGeometry
from fipt.stages.geometry.mesh_stage import MeshInputs, run
from fipt.stages.geometry.tsdf import fused

HALF = 1.5
"""Half of the side of the room, a cube around the origin."""


def view_of_cube(name: str, center: tuple[float, float, float], turn: float, noise: float = 0.0) -> DepthView:
    """A view from within the cube, turned about the vertical axis; its depth is exact but for noise."""
    pose = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    pose[:3, 3] = center
    return cube_through(Camera(name, "train", 80, 60, 50.0, 50.0, 40.0, 30.0, pose), noise)


def cube_through(camera: Camera, noise: float = 0.0) -> DepthView:
    """What a camera within the cube sees."""
    shape = camera.height, camera.width
    empty = DepthMap(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros((*shape, 3), np.float32))
    view = DepthView(camera, empty, np.ones((*shape, 3), np.float32))
    with np.errstate(divide="ignore"):
        far = np.where(view.rays > 0, (HALF - camera.center) / view.rays, (-HALF - camera.center) / view.rays)
    far = np.where(np.abs(view.rays) > 1e-9, far, np.inf)
    axis, depth = far.argmin(axis=-1), far.min(axis=-1)
    normal = -np.sign(np.take_along_axis(view.rays, axis[..., None], -1)) * np.eye(3)[axis]
    depth = depth + noise * depth**2 * np.random.default_rng(len(camera.name)).standard_normal(depth.shape)
    found = DepthMap(depth.astype(np.float32), np.ones(depth.shape, np.float32), normal.astype(np.float32))
    return view.with_map(found)


def around(noise: float = 0.0) -> list[DepthView]:
    """Views in all directions."""
    return [view_of_cube(f"v{i}" + "x" * i, (0.4 * (i % 3 - 1), 0.1, 0.3), i * np.pi / 4, noise) for i in range(8)]


def off_the_walls(mesh: Mesh) -> np.ndarray:
    return np.abs(HALF - np.abs(mesh.vertices)).min(axis=1)


@pytest.mark.usefixtures("open3d")
def test_a_cube_is_fused_from_its_views():
    views = around()
    mesh = fuse(views, [view.map.known for view in views], 1e-3, 0.05)
    off = off_the_walls(mesh)
    assert np.percentile(off, 95) < 0.002
    centers = mesh.corners.mean(axis=1)
    inward = (mesh.normals * -centers).sum(axis=1) > 0  # towards the cameras
    assert mesh.areas[inward].sum() > 0.99 * mesh.areas.sum()
    assert mesh.areas[np.abs(centers[:, 1]) < 1].sum() > 0.9 * 4 * 2 * HALF * 2


@pytest.mark.usefixtures("open3d")
def test_the_same_input_gives_the_same_mesh():
    views = around()[:3]
    one, other = (fuse(views, [view.map.known for view in views], 1e-3, 0.1) for _ in range(2))
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.triangles, other.triangles)


@pytest.mark.usefixtures("open3d")
def test_free_space_carves_what_one_view_says_by_mistake():
    views = [*around(), *(view_of_cube(f"behind{i}", (0.2 * i, 0.1, 1.0), 0.0) for i in range(2))]
    wrong = views[0].map.depth.copy()
    wrong[25:35, 35:45] = 0.7
    views[0] = views[0].with_map(DepthMap(wrong, views[0].map.confidence, views[0].map.normal))
    here = views[0].camera.center + 0.7 * views[0].rays[30, 40]
    carved = fuse(views, [view.map.known for view in views], 1e-3, 0.05)
    kept = fuse(views, [np.zeros_like(view.map.known) for view in views], 1e-3, 0.05)
    near_carved, near_kept = (
        np.linalg.norm(mesh.vertices - here, axis=1).min() if len(mesh.vertices) else np.inf for mesh in (carved, kept)
    )
    assert near_kept < 0.05 < near_carved


@pytest.mark.usefixtures("open3d")
def test_a_view_that_sees_through_a_wall_by_mistake_does_not_move_it():
    views = around()
    views += [view_of_cube(f"again{i}", (0.1 * i, 0.0, 0.0), 0.0) for i in range(3)]
    wrong = views[0].map.depth.copy()
    wrong[25:35, 35:45] *= 1.5
    views[0] = views[0].with_map(DepthMap(wrong, views[0].map.confidence, views[0].map.normal))
    mesh = fuse(views, [view.map.known for view in views], 1e-3, 0.05)
    there = views[0].camera.center + views[0].map.depth[30, 40] / 1.5 * views[0].rays[30, 40]
    near = np.linalg.norm(mesh.vertices - there, axis=1) < 0.15
    assert near.any()
    assert off_the_walls(mesh)[near].max() < 0.003


def over_a_table(name: str, center: tuple[float, float, float], turn: float, confidence: float) -> DepthView:
    """A view of the cube with a square board of 1 m in it, 0.6 m below its middle; y points up."""
    view = view_of_cube(name, center, turn)
    with np.errstate(divide="ignore"):
        depth = np.where(view.rays[..., 1] < 0, (-0.6 - center[1]) / view.rays[..., 1], np.inf)
    place = view.camera.center + view.rays * np.minimum(depth, 1e3)[..., None]
    board = (np.abs(place[..., ::2]) < 0.5).all(axis=-1) & (depth < view.map.depth)
    return view.with_map(
        DepthMap(
            np.where(board, depth, view.map.depth).astype(np.float32),
            np.full_like(view.map.confidence, confidence),
            np.where(board[..., None], [0.0, 1.0, 0.0], view.map.normal).astype(np.float32),
        )
    )


@pytest.mark.usefixtures("open3d")
def test_a_table_ends_where_views_see_past_it_however_certain_those_are_that_look_over_it():
    views = [over_a_table(f"over{i}", (0.1 * i, 0.1, 1.3), 0.0, 8.0) for i in range(3)]
    views += [over_a_table(f"past{i}", (-1.2, -0.3, -0.6 - 0.1 * i), -np.pi / 2, 1.0) for i in range(6)]
    mesh = fuse(views, [view.map.known for view in views], 1e-3, 0.05)
    near = mesh.vertices[(np.abs(mesh.vertices[:, :2] - [0.0, -0.6]) < [0.4, 0.2]).all(axis=1)]
    assert (np.abs(near[:, 2]) < 0.4).sum() > 100
    assert not (np.abs(near[:, 2] + 0.85) < 0.2).any()


@pytest.mark.usefixtures("open3d")
def test_a_view_close_by_knows_what_is_free_better_than_what_lies_far_behind():
    far, close = view_of_cube("far", (0.0, 0.0, 1.3), 0.0), view_of_cube("close", (0.0, 0.0, 0.9), 0.0)
    wrong = far.map.depth.copy()
    wrong[25:35, 35:45] = 0.8
    far = far.with_map(DepthMap(wrong, far.map.confidence, far.map.normal))
    # 0.4 m before the close view, which sees the wall 2 m behind: its noise there is no noise here
    mesh = fuse([far, close], [view.map.known for view in (far, close)], 0.05, 0.05)
    assert not (np.linalg.norm(mesh.vertices - [0.0, 0.0, 0.5], axis=1) < 0.1).any()


def test_noise_is_measured():
    assert depth_noise(around(0.01)).at_1m == pytest.approx(0.01, rel=0.15)
    # without noise, what a pixel can tell
    assert depth_noise(around()).at_1m < 0.002


def test_voxels_are_as_large_as_pixels():
    views = around()
    depth = np.concatenate([view.map.depth.ravel() for view in views])
    assert voxel_size(views, 0.001) == pytest.approx(np.median(depth) / 50)
    assert voxel_size(views, 0.5) == 0.5


def test_memory_is_refused_before_it_is_used():
    with pytest.raises(FiptError, match=r"geometry\.memory_gb is 0\.01"):
        check_memory(around(), 0.005, 0.01)


def test_images_and_blocks_take_memory():
    view = around()[0]
    few = view.map.known & (np.arange(80) < 4)
    bare = view.with_map(DepthMap(np.where(few, view.map.depth, 0), view.map.confidence, view.map.normal))
    check_memory([bare], 0.05, 0.1)
    with pytest.raises(FiptError, match="needs about"):
        check_memory([bare] * 1000, 0.05, 0.1)  # no blocks more
    with pytest.raises(FiptError, match="needs about"):
        check_memory([view], 0.005, 0.1)  # more blocks


def test_no_depth_at_all_is_said():
    view = around()[0]
    empty = view.with_map(DepthMap(0 * view.map.depth, 0 * view.map.depth, view.map.normal))
    with pytest.raises(FiptError, match="all pixels are unknown"):
        voxel_size([empty], 0.01)


def test_a_missing_open3d_is_said(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "open3d", None)
    with pytest.raises(FiptError, match=r"open3d must be importable .*pip install 'fipt\[geometry\]'"):
        fused(*(np.zeros(1) for _ in range(6)), 0.1, 0.1)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise ImportError('libGL.so.1: cannot open shared object file')", "libGL.so.1: cannot open"),
        ("import os; os.abort()", "exit code -6"),
    ],
    ids=["library", "crash"],
)
def test_an_open3d_that_cannot_be_imported_is_said_before_anything_is_read(tmp_path, monkeypatch, body, said):
    (tmp_path / "open3d.py").write_text(body)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    inputs = MeshInputs(dataset=tmp_path / "none", depth=tmp_path / "none", out=tmp_path / "out")
    with pytest.raises(FiptError, match=said):
        run(inputs, AutoGeometry())
