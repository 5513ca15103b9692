"""Where the cameras stand and what they see."""

import numpy as np
import pytest

from fipt.synthetic import poses
from fipt.synthetic.room import build
from fipt.synthetic.rooms.living_room import SIZE
from fipt.synthetic.settings import SynthesizeSettings

SETTINGS = SynthesizeSettings(train_views=8, val_views=3, width=64, height=48)


@pytest.fixture(scope="module")
def intersect(backend):
    from fipt.synthetic.views import Truth

    return Truth(build(0)).intersect


@pytest.fixture(scope="module")
def space(intersect):
    return poses.OpenSpace(build(0), intersect, 0)


@pytest.fixture(scope="module")
def cameras(space):
    return poses.sample_cameras(space, SETTINGS)


def test_names_and_splits(cameras):
    assert [c.name for c in cameras] == [f"train_{i:03d}" for i in range(8)] + [f"val_{i:03d}" for i in range(3)]
    assert all(c.split == c.name.split("_")[0] for c in cameras)


def test_cameras_stand_free_in_the_room(cameras):
    corners = build(0).mesh.corners.astype(np.float64)
    for camera in cameras:
        assert (camera.center > 0.29).all()
        assert (camera.center < np.array(SIZE) - 0.29).all()
        assert 0.5 <= camera.center[1] <= 2.5
        # Points sampled on the surfaces are 4 cm apart: allow for that.
        nearest = np.linalg.norm(corners - camera.center, axis=-1).min()
        assert nearest > poses.CLEARANCE - 0.04


def test_cameras_look_into_the_room_and_hardly_roll(cameras, intersect):
    for camera in cameras:
        right, _, back = camera.world_from_camera[:3, :3].T
        assert abs(np.degrees(np.arcsin(right[1]))) < 6
        assert -50.1 <= np.degrees(np.arcsin(-back[1])) <= 20.1
        np.testing.assert_allclose(
            camera.world_from_camera[:3, :3] @ camera.world_from_camera[:3, :3].T,
            np.eye(3),
            atol=1e-12,
        )
        assert np.linalg.det(camera.world_from_camera[:3, :3]) == pytest.approx(1)
        assert np.median(poses.scan(camera, intersect)[0]) > 1.2


def test_held_out_views_show_what_training_views_show(cameras, intersect):
    areas = build(0).mesh.areas
    seen = np.zeros(len(areas), bool)
    for camera in cameras[:8]:
        seen[poses.scan(camera, intersect, (96, 72))[1]] = True
    for camera in cameras[8:]:
        shown = poses.scan(camera, intersect)[1]
        assert areas[shown] @ seen[shown] / areas[shown].sum() > 0.8


def test_poses_repeat_and_more_views_keep_the_first(cameras, space):
    more = poses.sample_cameras(space, SETTINGS.model_copy(update={"train_views": 9, "val_views": 1}))
    for old, new in zip(cameras[:8], more, strict=False):
        np.testing.assert_array_equal(old.world_from_camera, new.world_from_camera)
    other = poses.sample_cameras(
        space,
        SETTINGS.model_copy(update={"seed": 1, "train_views": 1, "val_views": 1}),
    )
    assert not np.allclose(other[0].world_from_camera, cameras[0].world_from_camera)


def test_a_walk_goes_around_in_steps_that_show_much_of_the_same(space, intersect):
    settings = SETTINGS.model_copy(update={"cameras": "walk", "train_views": 18, "val_views": 6})
    cameras = poses.sample_cameras(space, settings)
    assert [c.name for c in cameras] == [f"train_{i:03d}" for i in range(18)] + [f"val_{i:03d}" for i in range(6)]
    assert all(space.holds(camera.center) for camera in cameras)
    yaw = np.array([np.arctan2(*camera.world_from_camera[[0, 2], 2]) for camera in cameras])
    steps = np.diff(np.sort(np.degrees(yaw % (2 * np.pi))))
    assert steps.max() < 25  # an ellipse's steps differ; a circle's would be 15
    middle = np.array(SIZE) / 2
    for camera in cameras:
        column, depth = camera.project(middle[None])
        assert depth[0] > 0
        assert 0 < column[0, 0] < camera.width  # it looks across the room
    order = np.argsort(yaw)
    shown = [set(poses.scan(cameras[i], intersect)[1]) for i in order]
    for one, other in zip(shown, shown[1:] + shown[:1], strict=True):
        assert len(one & other) > 0.3 * min(len(one), len(other))
