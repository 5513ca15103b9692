"""Views with wrong cameras are found through the first mesh, and the second one is made without them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.formats.exr import write_exr
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.depth_maps import DepthMap, write_depth_map
from fipt.scene.mesh import read_mesh
from tests import room_views

SIZE = (80, 60)
SETTINGS = {"voxel": 0.08, "planes": False, "cut_edges": False, "triangle_size": 4.0}


def depth_of_box(camera: Camera) -> DepthMap:
    """Depth of the box room from a camera, exact."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = camera.rays(columns, rows)
    with np.errstate(divide="ignore"):
        far = np.where(rays > 0, np.array(room_views.SIZE) - camera.center, -camera.center) / rays
    far = np.where(np.abs(rays) > 1e-9, far, np.inf)
    axis = far.argmin(axis=-1)
    normal = -np.sign(np.take_along_axis(rays, axis[..., None], -1)) * np.eye(3)[axis]
    depth = far.min(axis=-1).astype(np.float32)
    return DepthMap(depth, np.ones_like(depth), normal.astype(np.float32))


def wrong(camera: Camera, turn: float = 0.0, shift: float = 0.0) -> Camera:
    """The camera, turned by degrees about its upright axis, moved by metres to its right."""
    pose, c, s = camera.world_from_camera.copy(), np.cos(np.radians(turn)), np.sin(np.radians(turn))
    pose[:3, 3] += shift * pose[:3, 0]
    pose[:3, :3] = pose[:3, :3] @ [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return replace(camera, world_from_camera=pose)


def write_room(folder: Path, errors: bool = True) -> None:
    """Views and depth maps of the box room; the cameras of two are wrong, unless there are to be no errors."""
    boards = [
        room_views.charuco((1.6, 0.001, 1.4), (1, 0, 0.3), (-0.3, 0, 1), square=0.3),
        room_views.charuco((2.0, 2.2, 0.001), (1, 0, 0), (0, -1, 0), square=0.2),
    ]
    cameras = room_views.cameras(12, size=SIZE, target=(2.5, 0.9, 2.0))
    for camera in cameras:
        write_exr(folder / "views" / "images" / f"{camera.name}.exr", {"": room_views.draw(camera, boards)})
        write_depth_map(folder / "depth" / f"{camera.name}.exr", depth_of_box(camera))
    if errors:
        cameras[3], cameras[8] = wrong(cameras[3], turn=4.0), wrong(cameras[8], shift=0.25)
    write_transforms(folder / "views" / "transforms.json", cameras)
    write_views(folder / "views" / "views.json", [camera.name for camera in cameras])


def off_the_walls(path: Path) -> np.ndarray:
    """(V,) metres of a mesh's vertices from the nearest wall."""
    vertices = read_mesh(path).vertices
    return np.minimum(np.abs(vertices), np.abs(vertices - np.array(room_views.SIZE))).min(axis=1)


@pytest.mark.usefixtures("open3d")
def test_wrong_cameras_are_named_and_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_room(tmp_path)
    mesh = ["mesh", "--dataset", "views", "--depth", "depth", "--settings", json.dumps(SETTINGS)]
    assert main([*mesh, "--out", "first"]) == 0
    check = ["check-poses", "views", "--reject", "--mesh", "first/mesh.ply", "--out", "check.json"]
    assert main(check) == 0
    states = json.loads(Path("check.json").read_text())["views"]
    names = [camera.name for camera in room_views.cameras(12)]
    assert [name for name, state in states.items() if not state["accepted"]] == [names[3], names[8]]
    # a mesh that wrong views helped to make does not tell by how little others are off
    assert all(state["displacement"] is None for state in states.values())
    assert main([*mesh, "--out", "second", "--first", "first", "--checked", "check.json"]) == 0
    about = json.loads(Path("second/geometry.json").read_text())
    assert list(about["rejected"]) == [names[3], names[8]]
    assert about["views"] == 10
    first, second = ((off_the_walls(Path(name, "mesh.ply")) > 0.03).mean() for name in ("first", "second"))
    assert first > 0.2
    assert second < 0.01

    # where all are accepted, the first mesh is taken over
    Path("all.json").write_text(json.dumps({"views": {name: {"accepted": True} for name in names}}))
    assert main([*mesh, "--out", "third", "--first", "first", "--checked", "all.json"]) == 0
    for name in ("mesh.ply", "geometry.json", "overview.png"):
        assert Path("third", name).read_bytes() == Path("first", name).read_bytes()
