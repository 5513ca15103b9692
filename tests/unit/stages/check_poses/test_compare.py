"""Wrong cameras are found through the mesh, and no good one is rejected; views are drawn by plain NumPy."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.views import read_gains
from fipt.scene.dataset import CHECKED, Dataset
from fipt.scene.mesh import write_ply
from fipt.stages.check_poses.settings import CheckPosesSettings
from fipt.stages.check_poses.stage import CheckPosesInputs, run
from tests import room_views, scenes

SIZE = (120, 90)
SMALL = {"width": 60, "partners": 4}
"""Settings of a check that is repeated."""


@pytest.fixture(scope="module")
def views():
    """Twelve views of the box room with a board on the floor and one on a wall."""
    boards = [
        room_views.charuco((1.6, 0.001, 1.4), (1, 0, 0.3), (-0.3, 0, 1), square=0.3),
        room_views.charuco((2.0, 2.2, 0.001), (1, 0, 0), (0, -1, 0), square=0.2),
    ]
    views = room_views.cameras(12, size=SIZE, target=(2.5, 0.9, 2.0))
    return {view.name: room_views.draw(view, boards) for view in views}


def ring():
    return room_views.cameras(12, size=SIZE, target=(2.5, 0.9, 2.0))


def written(folder, cameras, views):
    """The dataset of some cameras and their views."""
    return room_views.write_dataset(folder, list(zip(cameras, views, strict=True)))


def posed(camera, turn=None, shift=0.0):
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ (np.eye(3) if turn is None else turn)
    pose[:3, 3] += shift
    return replace(camera, world_from_camera=pose)


def mirrored(camera, axis):
    """The camera on the other side of the room's middle, looking there as its mirror image does."""
    flip = np.eye(3)
    flip[axis, axis] = -1
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = flip @ pose[:3, :3] @ np.diag([-1, 1, 1])
    pose[axis, 3] = room_views.SIZE[axis] - pose[axis, 3]
    return replace(camera, world_from_camera=pose)


def by_degrees(angle, axis):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.radians(angle) * np.array(axis) / np.linalg.norm(axis)).as_matrix()


def verdicts(folder, **settings):
    from fipt.render.scene import RayScene
    from fipt.stages.check_poses.compare import judge
    from fipt.stages.check_poses.surface import shown_views

    data, chosen = Dataset(folder), CheckPosesSettings(**settings)
    scene = RayScene(data.mesh())
    return {verdict.view: verdict for verdict in judge(scene, shown_views(scene, data, chosen.width), chosen)}


def test_good_cameras_stay(backend, tmp_path, views):
    found = verdicts(written(tmp_path, ring(), views.values()))
    assert all(verdict.accepted and not verdict.reason for verdict in found.values())
    assert min(verdict.score for verdict in found.values()) > 0.8
    assert found == verdicts(tmp_path)  # the same numbers again


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_mirrored_a_turned_and_two_swapped_cameras_are_found(backend, tmp_path, views, seed):
    """The plants of the issue, three times; nothing else is rejected."""
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.choice(12, 4, replace=False)
    cameras, shown = ring(), list(views.values())
    cameras[a] = mirrored(cameras[a], int(rng.choice([0, 2])))
    cameras[b] = posed(cameras[b], by_degrees(5, rng.normal(size=3)))
    shown[c], shown[d] = shown[d], shown[c]
    found = verdicts(written(tmp_path, cameras, shown))
    assert {view for view, verdict in found.items() if not verdict.accepted} == {f"v{i}" for i in (a, b, c, d)}
    good = [verdict.score for verdict in found.values() if verdict.accepted]
    bad = [verdict.score for verdict in found.values() if not verdict.accepted and verdict.score is not None]
    assert min(good) > 2 * max(bad)
    assert f"the image of v{d} fits there: are they swapped?" in found[f"v{c}"].reason


def test_a_mirrored_image_and_a_camera_outside_are_named(backend, tmp_path, views):
    cameras, shown = ring(), list(views.values())
    shown[2] = shown[2][:, ::-1]
    cameras[7] = mirrored(cameras[7], 0)
    pose = cameras[7].world_from_camera.copy()
    pose[0, 3] = 5.0 + (5.0 - pose[0, 3])  # beyond the wall
    cameras[7] = replace(cameras[7], world_from_camera=pose)
    found = verdicts(written(tmp_path, cameras, shown))
    assert found["v2"].reason.endswith("its image fits there mirrored")
    assert "v7" in {view for view, verdict in found.items() if not verdict.accepted}
    assert sum(not verdict.accepted for verdict in found.values()) == 2


def test_a_view_of_nothing_is_not_judged(backend, tmp_path, views):
    """A bare wall proves nothing against a camera: it stays, and the reason says so."""
    shown = dict(views)
    shown["v4"] = np.full_like(shown["v4"], 0.4)
    cameras = ring()
    cameras[4] = room_views.look_at("v4", (2.5, 1.5, 1.5), (2.5, 2.7, 1.4), SIZE, fov=30)  # the ceiling
    found = verdicts(written(tmp_path, cameras, shown.values()))
    assert found["v4"].accepted
    assert found["v4"].reason.startswith("not judged: others show")


def test_colour_of_a_lamp_does_not_matter(backend, tmp_path, views):
    """Images of another exposure have the same structure."""
    shown = [image * factor for image, factor in zip(views.values(), np.linspace(0.3, 3, 12), strict=True)]
    found = verdicts(written(tmp_path, ring(), shown))
    assert all(verdict.accepted for verdict in found.values())


def test_the_command_prints_fails_and_rejects(backend, tmp_path, views, capsys):
    cameras = ring()
    cameras[5] = posed(cameras[5], by_degrees(5, (0, 1, 0)))
    written(tmp_path, cameras, views.values())
    assert main(["check-poses", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "1 of 12 views do not show what the others show: v5; correct their cameras, or leave them" in said.err
    table = said.err.partition("verdict\n")[2].splitlines()
    assert table[0].startswith("v5")
    assert "REJECTED" in table[0]
    assert not (tmp_path / CHECKED).exists()

    small = ["--reject", "--settings", json.dumps(SMALL)]
    assert main(["check-poses", str(tmp_path), *small]) == 0
    assert "correlation" in Dataset(tmp_path).rejected["v5"]
    assert len(Dataset(tmp_path).cameras) == 11
    # The check looks at all views again, not at those it left.
    assert main(["check-poses", str(tmp_path), *small]) == 0
    assert len(json.loads((tmp_path / CHECKED).read_text())["views"]) == 12
    # Switched off, it accepts all.
    assert main(["check-poses", str(tmp_path), "--reject", "--settings", '{"enabled": false}']) == 0
    assert len(Dataset(tmp_path).cameras) == 12


def test_a_mesh_elsewhere_is_an_error(backend, tmp_path, views, capsys):
    written(tmp_path, ring(), views.values())
    write_ply(tmp_path / "mesh.ply", scenes.box((-1.5, -1, -1), (7, 4, 6)))
    assert main(["check-poses", str(tmp_path), "--reject"]) == 2
    assert "at least 70% of the views must show what others show through the mesh" in capsys.readouterr().err
    assert not (tmp_path / CHECKED).exists()


def test_thereduced_camera_is_the_same_camera(tmp_path, views):
    from fipt.stages.check_poses.surface import reduced

    camera = ring()[0]
    written(tmp_path, [camera], [views["v0"]])
    small, light, valid, _ = reduced(Dataset(tmp_path), camera, 50)
    assert (small.width, small.height) == (40, 30) == light.shape[::-1]
    assert valid.all()
    corners = np.array([[0.0, 0.0], [40.0, 30.0]])
    np.testing.assert_allclose(small.directions(*corners.T), camera.directions(*(3 * corners).T), atol=1e-6)
    block = views["v0"][3:6, 6:9, 1].mean()
    assert np.exp(light[1, 2]) == pytest.approx(block, rel=1e-4)


def test_masked_pixels_do_not_darken_the_blocks_at_a_mask(tmp_path):
    from fipt.stages.check_poses.surface import reduced

    camera = ring()[0]
    written(tmp_path, [camera], [np.ones((camera.height, camera.width, 3), np.float32)])
    valid = np.ones((camera.height, camera.width), np.float32)
    valid[:, :31] = 0  # one of the three columns of a block
    write_exr(tmp_path / "images" / "v0.exr", {"": np.ones((*valid.shape, 3), np.float32), "valid.Y": valid})
    _, light, known, _ = reduced(Dataset(tmp_path), camera, 50)
    assert known[:, 10].all()
    np.testing.assert_allclose(light[known], 0, atol=1e-5)


def with_exposure(views, name, factor):
    return [image * (factor if view == name else 1.0) for view, image in views.items()]


def test_a_view_of_another_exposure_stays_and_is_named(backend, tmp_path, views):
    found = verdicts(written(tmp_path, ring(), with_exposure(views, "v3", 2.0)))
    assert found["v3"].exposure == pytest.approx(2, abs=0.1)
    assert [view for view, verdict in found.items() if verdict.reason] == ["v3"]
    assert found["v3"].accepted
    assert "times as bright as others show the same surface: another exposure?" in found["v3"].reason
    assert found["v3"].gain == pytest.approx(0.5, abs=0.025)
    assert all(verdict.gain == 1 for view, verdict in found.items() if view != "v3")


def test_an_exposure_is_corrected_wherever_the_image_is_read(backend, tmp_path, views):
    images = with_exposure(views, "v3", 2.0)
    written(tmp_path, ring(), images)
    run(CheckPosesInputs(dataset=tmp_path, reject=True), CheckPosesSettings(**SMALL))
    raw, corrected = Dataset(tmp_path, unchecked=True), Dataset(tmp_path)
    for view in ("v2", "v3"):
        np.testing.assert_allclose(corrected.image(view)[0], views[view], rtol=0.05)
    np.testing.assert_array_equal(raw.image("v3")[0], images[list(views).index("v3")].astype(np.float32))
    run(CheckPosesInputs(dataset=tmp_path, reject=True), CheckPosesSettings(**SMALL, correct_exposure=False))
    np.testing.assert_array_equal(Dataset(tmp_path).image("v3")[0], raw.image("v3")[0])


@pytest.mark.parametrize("gain", [0, -1, "x", None, 1e400])
def test_a_gain_that_is_none_is_refused(tmp_path, gain):
    state = {"accepted": True, "reason": "", "gain": gain}
    (tmp_path / CHECKED).write_text(json.dumps({"views": {"a": state}}))
    with pytest.raises(FiptError, match=r"check_poses.json is not a check_poses.json"):
        read_gains(tmp_path / CHECKED)
