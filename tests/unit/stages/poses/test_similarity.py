"""Similarities between points and cameras, with wrong ones among them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fipt.errors import FiptError
from fipt.scene.cameras import write_transforms
from fipt.stages.poses.model import Reconstruction, Tracks, transformed
from fipt.stages.poses.reference import to_reference
from fipt.stages.poses.similarity import (
    camera_similarity,
    collinear,
    distances,
    fit_similarity,
    matrix,
    robust_similarity,
    rotation_angles,
)
from tests import painted_room

MOVED = matrix(0.37, Rotation.from_euler("xyz", [10, 200, -50], degrees=True).as_matrix(), np.array([3.0, -1, 2]))


def model(cameras):
    """A reconstruction of cameras and of their own places as points."""
    nothing = Tracks(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2), np.float32))
    places = np.array([camera.center for camera in cameras])
    return Reconstruction(tuple(cameras), places, np.zeros(len(places), np.float32), nothing)


def test_a_similarity_is_found_exactly_and_mirrors_are_not_one():
    points = np.random.default_rng(0).normal(size=(7, 3))
    moved = points @ MOVED[:3, :3].T + MOVED[:3, 3]
    np.testing.assert_allclose(fit_similarity(points, moved), MOVED, atol=1e-12)
    assert distances(fit_similarity(points, points * (-1, 1, 1)), points, points * (-1, 1, 1)).max() > 0.3


@pytest.mark.parametrize("count", [8, 40])
def test_wrong_points_do_not_count(count):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(count, 3))
    moved = points @ MOVED[:3, :3].T + MOVED[:3, 3]
    wrong = np.arange(count) % 3 == 0
    moved[wrong] += rng.normal(size=(wrong.sum(), 3))
    found, good = robust_similarity(points, moved, 0.01, seed=0)
    np.testing.assert_allclose(found, MOVED, atol=1e-9)
    np.testing.assert_array_equal(good, ~wrong)


def test_cameras_move_rigidly_and_see_their_points_where_they_did():
    cameras = painted_room.ring(4)
    scene = model(cameras)
    after = transformed(scene, MOVED)
    for before, camera in zip(cameras, after.cameras, strict=True):
        rotation = camera.world_from_camera[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        ahead = before.center - 2 * before.world_from_camera[:3, 2] + 0.3 * before.world_from_camera[:3, 0]
        moved = MOVED[:3, :3] @ ahead + MOVED[:3, 3]
        np.testing.assert_allclose(camera.project(moved[None])[0], before.project(ahead[None])[0], atol=1e-8)
    np.testing.assert_allclose(after.points, after.centers)


@pytest.mark.parametrize("count", [3, 12])
def test_cameras_agree_but_for_a_turned_and_a_shifted_one(count):
    before = model(painted_room.ring(count))
    after = transformed(before, MOVED)
    source = np.array([camera.world_from_camera for camera in before.cameras])
    target = np.array([camera.world_from_camera for camera in after.cameras])
    if count > 3:
        target[0, :3, :3] = target[0, :3, :3] @ Rotation.from_euler("y", 170, degrees=True).as_matrix()
        target[4, :3, 3] += 0.5
    found = camera_similarity(source, target, 0.02, seed=0)
    np.testing.assert_allclose(found, MOVED, atol=1e-9)


def test_angles_of_rotations():
    turns = Rotation.from_euler("x", [[0.001], [30], [179.9]], degrees=True).as_matrix()
    np.testing.assert_allclose(rotation_angles(turns, np.eye(3)), [0.001, 30, 179.9], rtol=1e-6)


def test_a_reference_gives_metres_and_names_what_does_not_fit(tmp_path):
    truth = painted_room.ring(8)
    estimated = transformed(model(truth), np.linalg.inv(MOVED))
    wrong = replace(truth[2], world_from_camera=truth[5].world_from_camera)
    known = [wrong if camera is truth[2] else camera for camera in truth[:6]]
    write_transforms(tmp_path / "known.json", known)
    found, report = to_reference(estimated, tmp_path / "known.json")
    np.testing.assert_allclose(transformed(estimated, found).centers, [camera.center for camera in truth], atol=1e-9)
    assert list(report.outliers) == ["view_02"]
    assert report.cameras == ("view_00", "view_01", "view_03", "view_04", "view_05")
    assert report.largest < 1e-9
    assert report.scale == pytest.approx(0.37)


def test_references_that_do_not_fix_the_poses(tmp_path):
    truth = painted_room.ring(8)
    write_transforms(tmp_path / "two.json", truth[:2])
    with pytest.raises(FiptError, match=r"at least 3 estimated cameras; it has 2 \(view_00, view_01\)"):
        to_reference(model(truth), tmp_path / "two.json")
    line = [painted_room.camera(camera.name, (i, 1, 1), 0) for i, camera in enumerate(truth)]
    assert collinear(np.array([camera.center for camera in line]), 1e-6)
    write_transforms(tmp_path / "line.json", line)
    with pytest.raises(FiptError, match="must not lie on one line"):
        to_reference(model(line), tmp_path / "line.json")
    rng = np.random.default_rng(3)
    places = rng.uniform(0, 3, (8, 3))
    other = [painted_room.camera(c.name, place, 0) for c, place in zip(truth, places, strict=True)]
    write_transforms(tmp_path / "other.json", other)
    with pytest.raises(FiptError, match="of 8 positions fit the estimated cameras"):
        to_reference(model(truth), tmp_path / "other.json")
