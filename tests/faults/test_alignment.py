"""Cameras and meshes that are off by little, and light lost in corners, are named; sound ones are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fipt.render.variant import Backend
from fipt.scene.cameras import Camera
from fipt.scene.dataset import CHECKED
from fipt.scene.findings import read_findings
from fipt.stages.check_poses.settings import CheckPosesSettings
from fipt.stages.check_poses.stage import CheckPosesInputs, run
from tests import room_views, scenes

SIZE = (96, 72)


@pytest.fixture(scope="module")
def views() -> list[tuple[Camera, np.ndarray]]:
    """Eight views of the box room with boards on its floor and its walls."""
    width, height, depth = room_views.SIZE
    cameras = room_views.cameras(8, size=SIZE, target=(width / 2, height / 3, depth / 2))
    boards = room_views.walled()
    return [(camera, room_views.draw(camera, boards)) for camera in cameras]


def warned(folder: Path, views: list[tuple[Camera, np.ndarray]], shift: float = 0.0, size: float = 1.0) -> list[str]:
    """What the check says of views and of a box room that is moved along z and made larger."""
    mesh = scenes.box((0, 0, 0), room_views.SIZE)
    middle = np.array(room_views.SIZE) / 2
    vertices = (mesh.vertices - middle) * size + middle + (0, 0, shift)
    room_views.write_dataset(folder, views, replace(mesh, vertices=vertices.astype(np.float32)))
    settings = CheckPosesSettings(least_score=0.3)  # or boards, which are all edges, are enough to reject a view
    return run(CheckPosesInputs(dataset=folder, reject=True), settings)["warnings"]


def test_sound_rooms_are_silent(backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]) -> None:
    assert warned(tmp_path, views) == []


def test_a_camera_that_is_turned_by_little_is_named(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    camera, image = views[3]
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = Rotation.from_rotvec(np.radians([0.7, 1.5, 0.4])).as_matrix() @ pose[:3, :3]
    off = [*views[:3], (replace(camera, world_from_camera=pose), image), *views[4:]]
    finding, said = warned(tmp_path, off)
    assert finding.startswith(f"{camera.name} are off from where others show them")
    assert said.startswith(f"{camera.name} is off by ")
    assert " of 96 pixels from what others show" in said


def test_a_mesh_aside_of_the_cameras_room_is_named(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    said = warned(tmp_path, views, shift=0.1)
    assert any("The mesh is not where the views show it" in line for line in said)
    assert "mesh-misplaced" in {finding.id for finding in read_findings(tmp_path / CHECKED)}


def test_a_mesh_five_percent_too_large_is_named(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    said = [line for line in warned(tmp_path, views, size=1.05) if "The mesh is not where the views show it" in line]
    factor = float(said[0].split(" times as large")[0].split()[-1])
    assert factor == pytest.approx(1 / 1.05, abs=0.01)


def test_light_lost_in_the_corners_is_named(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    radius = 4 * ((columns - SIZE[0] / 2) ** 2 + (rows - SIZE[1] / 2) ** 2) / (SIZE[0] ** 2 + SIZE[1] ** 2)
    darker = np.exp(np.log(0.75) * radius)[..., None].astype(np.float32)
    (said,) = warned(tmp_path, [(camera, image * darker) for camera, image in views])
    assert float(said.split(" show ")[1].split()[0]) == pytest.approx(0.75, abs=0.03)
    assert "vignetting" in said
