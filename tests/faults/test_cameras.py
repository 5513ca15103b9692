"""Cameras are not trusted: a mistake that all of them share is named, and blamed on no view."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.render.scene import RayScene
from fipt.render.variant import Backend
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.stages.check_poses import diagnose
from fipt.stages.check_poses.color import judged_by_color
from fipt.stages.check_poses.compare import enough, judge
from fipt.stages.check_poses.diagnose import Correction, agreement, corrections, doubt, explain
from fipt.stages.check_poses.settings import CheckPosesSettings
from fipt.stages.check_poses.surface import reduced, shown_views
from fipt.stages.check_poses.verdict import Verdict
from tests import room_views
from tests.faults.faults import refused


@pytest.fixture(scope="module")
def views() -> list[tuple[Camera, np.ndarray]]:
    """Eight views of the box room, with a board on the floor and one on a wall."""
    boards = [
        room_views.charuco((1.6, 0.001, 1.4), (1, 0, 0.3), (-0.3, 0, 1), square=0.3),
        room_views.charuco((2.0, 2.2, 0.001), (1, 0, 0), (0, -1, 0), square=0.2),
    ]
    cameras = room_views.cameras(8, size=(96, 72), target=(2.5, 0.9, 2.0))
    return [(camera, room_views.draw(camera, boards)) for camera in cameras]


def dataset(folder: Path, views: list[tuple[Camera, np.ndarray]]) -> Dataset:
    return Dataset(room_views.write_dataset(folder, views))


def by_color(data: Dataset) -> list[Verdict]:
    """Verdicts by structure and colour."""
    scene = RayScene(data.mesh())
    views = shown_views(scene, data, 96)
    return judged_by_color(scene, views, judge(scene, views, CheckPosesSettings()))


def judged(score: float) -> list[Verdict]:
    return [Verdict(name, score, 0.5, 0.0, 0.5, 1.0, (), True, "") for name in "abc"]


def pose(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Camera, np.ndarray], tuple[Camera, np.ndarray]]:
    return lambda camera, image: (replace(camera, world_from_camera=change(camera.world_from_camera)), image)


def zoomed(factor: float) -> Callable[[Camera, np.ndarray], tuple[Camera, np.ndarray]]:
    return lambda camera, image: (replace(camera, fx=camera.fx * factor, fy=camera.fy * factor), image)


def transposed(matrix: np.ndarray) -> np.ndarray:
    turned = matrix.copy()
    turned[:3, :3] = matrix[:3, :3].T
    return turned


OPENCV = np.diag([1.0, -1, -1, 1])
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
MISTAKES = {
    "OpenCV's axes": (pose(lambda m: m @ OPENCV), "camera axes are those of OpenCV"),
    "FIPT's axes": (pose(lambda m: m @ np.diag([-1.0, 1, -1, 1])), "camera axes are x left, y up, z ahead"),
    "inverted": (pose(np.linalg.inv), "poses are world to camera (inverted)"),
    "COLMAP's extrinsics": (pose(lambda m: np.linalg.inv(m @ OPENCV)), "world to camera in OpenCV's axes"),
    "transposed": (pose(transposed), "rotations are transposed"),
    "z up": (pose(lambda m: Z_UP @ m), "z is up for the cameras and y for the mesh"),
    "a wide field of view": (zoomed(0.8), "the focal length is about 1.25 times the stated one"),
    "a narrow field of view": (zoomed(1.2), "the focal length is about 0.85 times the stated one"),
    "mirrored images": (lambda camera, image: (camera, image[:, ::-1]), "images are mirrored"),
    "images upside down": (lambda camera, image: (camera, image[::-1]), "images are upside down"),
    "a principal point": (
        lambda camera, image: (replace(camera, cx=camera.cx + 12), image),
        "the principal point is in the middle of the image",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_all_cameras_have_in_common_is_found(
    mistake: str, backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    change, said = MISTAKES[mistake]
    data = dataset(tmp_path, [change(camera, image) for camera, image in views])
    scene, shown = RayScene(data.mesh()), [reduced(data, camera, 96) for camera in data.cameras]
    bounds = np.array([np.zeros(3), room_views.SIZE])
    wanted = [each for each in corrections(data.cameras, bounds) if said in each.wrong]
    assert len(wanted) == 1
    assert agreement(scene, shown, Correction("nothing", lambda camera: camera)) < 0.6
    assert agreement(scene, shown, wanted[0]) > 0.8


def test_sound_cameras_have_no_mistake_in_common(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(diagnose, "_FACTORS", (0.9, 1.1))
    explain(dataset(tmp_path, views), judged(0.1), CheckPosesSettings())  # looked at: nothing fits better
    broken = dataset(tmp_path / "missing", views)
    (broken.root / "mesh.ply").unlink()
    explain(broken, judged(0.8), CheckPosesSettings())  # not even looked at


def test_the_command_says_it_and_blames_no_view(
    backend: Backend,
    tmp_path: Path,
    views: list[tuple[Camera, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(diagnose, "_FACTORS", (0.9, 1.1))
    change, _ = MISTAKES["OpenCV's axes"]
    dataset(tmp_path, [change(camera, image) for camera, image in views])
    said = refused(capsys, "check-poses", str(tmp_path), "--reject")
    assert "if camera axes are those of OpenCV (y down, looks along +z); correct the source or its format" in said
    assert not (tmp_path / "check_poses.json").exists()


def test_a_mirrored_mesh_is_found(backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]) -> None:
    """The cameras stand in the room as it is; the mesh has -x for x."""
    data = dataset(tmp_path, views)
    mesh = data.mesh()
    other = replace(mesh, vertices=mesh.vertices * np.array([-1, 1, 1], np.float32))
    bounds = np.stack([other.vertices.min(axis=0), other.vertices.max(axis=0)])
    wanted = [each for each in corrections(data.cameras, bounds) if "the mesh is mirrored" in each.wrong]
    assert [each.wrong for each in wanted] == ["the mesh is mirrored, x for -x"]
    shown = [reduced(data, camera, 96) for camera in data.cameras]
    assert agreement(RayScene(other), shown, wanted[0]) > 0.8


def test_views_that_hardly_agree_are_a_warning() -> None:
    assert doubt(judged(0.7)) == doubt([]) == []
    (found,) = doubt([*judged(0.5), *judged(0.4)])
    assert found.cause.startswith("Cameras, images and mesh hardly fit: views agree by 0.45")


WARM = np.array([1.2, 1.0, 0.6], np.float32)


@pytest.mark.parametrize(
    ("color", "exchanged", "found"),
    [
        (WARM, (), ()),
        (WARM, (2,), ("v2",)),
        (WARM[::-1], (1, 6), ("v1", "v6")),
        (WARM, range(8), ()),  # nothing tells
        (np.ones(3, np.float32), (2,), ()),  # grey is grey
    ],
)
def test_red_and_blue_exchanged_in_single_views(
    color: np.ndarray,
    exchanged: Sequence[int],
    found: tuple[str, ...],
    backend: Backend,
    tmp_path: Path,
    views: list[tuple[Camera, np.ndarray]],
) -> None:
    shown = [(c, image * (color[::-1] if i in exchanged else color)) for i, (c, image) in enumerate(views)]
    verdicts = by_color(dataset(tmp_path, shown))
    assert {verdict.view for verdict in verdicts if not verdict.accepted} == set(found)
    assert all("with red and blue exchanged (BGR for RGB?)" in v.reason for v in verdicts if v.view in found)


def test_a_view_at_another_exposure_is_named_and_brought_to_that_of_others(
    backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    shown = [(c, image * (0.5 if i == 4 else 1.0)) for i, (c, image) in enumerate(views)]
    verdicts = by_color(dataset(tmp_path, shown))
    assert all(verdict.accepted for verdict in verdicts)
    assert [v.view for v in verdicts if "as bright as others show the same surface" in v.reason] == ["v4"]
    assert verdicts[4].gain == pytest.approx(2, abs=0.05)


@pytest.mark.parametrize(
    ("cast", "said"),
    [((1.4, 1, 1), "1.40 times as much red over blue"), ((1, 1.5, 1), "1.50 times as much green")],
)
def test_a_cast_of_a_view_is_named(
    cast: tuple[float, ...], said: str, backend: Backend, tmp_path: Path, views: list[tuple[Camera, np.ndarray]]
) -> None:
    shown = [(c, image * (WARM * np.array(cast, np.float32) if i == 3 else WARM)) for i, (c, image) in enumerate(views)]
    verdicts = by_color(dataset(tmp_path, shown))
    assert all(verdict.accepted for verdict in verdicts)
    assert [v.view for v in verdicts if "another white balance?" in v.reason] == ["v3"]
    assert f"shows {said}" in verdicts[3].reason


def test_too_many_exchanged_views_end_the_check_with_their_reason() -> None:
    reason = "shows what others show with red and blue exchanged (BGR for RGB?)"
    odd = [replace(verdict, accepted=False, reason=reason) for verdict in judged(0.9)]
    with pytest.raises(FiptError, match=r"2 of 5 do not: a, b; a shows what others show with red and blue exchanged"):
        enough([*odd[:2], *judged(0.9)], CheckPosesSettings())
