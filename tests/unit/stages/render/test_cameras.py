"""Free cameras and camera paths: where they stand, which way they look, how they move."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from fipt.errors import FiptError
from fipt.scene.dataset import Dataset
from fipt.scene.setup import OwnCameras, RelightSetup, parse_cameras
from fipt.stages.render.cameras import chosen_cameras, own_cameras
from tests import scenes


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("scene") / "dataset"
    scenes.write_dataset(root)
    return Dataset(root)


def along(data, *keyframes, frames=41, **keys):
    path = {"keyframes": keyframes, "frames": frames, **keys}
    return own_cameras(OwnCameras.model_validate({"path": path}), data)


def at(x, y, z, towards=(0, 0, -1)):
    return {"position": (x, y, z), "target": tuple(np.add((x, y, z), towards))}


def places(cameras):
    return np.array([camera.center for camera in cameras])


def ahead(cameras):
    return np.array([-camera.world_from_camera[:3, 2] for camera in cameras])


def test_a_free_camera_sees_its_target_in_the_middle(data):
    aim = {"position": (1, 2, 3), "target": (2, 0.5, -1), "fov": 90, "width": 200, "height": 100}
    (camera,) = own_cameras(OwnCameras.model_validate({"look_at": {"desk": aim}}), data)
    assert (camera.name, camera.width, camera.height) == ("desk", 200, 100)
    image, depth = camera.project(np.array([aim["target"], (1, 3, 3.0)]))
    np.testing.assert_allclose(image[0], (100, 50), atol=1e-9)
    assert depth[0] == pytest.approx(np.linalg.norm(np.subtract(aim["target"], aim["position"])))
    assert image[1][0] == pytest.approx(100)  # what is above stands above
    # 90 degrees from the left edge to the right one
    edges = camera.directions(np.array([0, 200]), np.array([50, 50])).astype(float)
    assert np.degrees(np.arccos(edges[0] @ edges[1])) == pytest.approx(90, abs=1e-3)


def test_sizes_and_field_of_view_are_those_of_the_first_view_unless_stated(data):
    first, place = data.cameras[0], at(1, 1, 1)
    cameras = {"plain": place, "large": {**place, "width": 2 * first.width, "height": 2 * first.height}}
    cameras["tall"] = {**place, "vertical_fov": 60, "height": 90}
    plain, large, tall = own_cameras(OwnCameras.model_validate({"look_at": cameras}), data)
    assert (plain.width, plain.height, plain.fx) == (first.width, first.height, first.fx)
    assert large.fx == 2 * first.fx
    assert tall.fy == tall.fx == pytest.approx(45 / np.tan(np.radians(30)))


def test_up_is_that_of_the_views_or_stated(data):
    cameras = {"plain": at(1, 1, 1), "turned": {**at(1, 1, 1), "up": (5, 0, 0)}}
    plain, turned = own_cameras(OwnCameras.model_validate({"look_at": cameras}), data)
    np.testing.assert_allclose(plain.world_from_camera[:3, 1], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(turned.world_from_camera[:3, 1], (1, 0, 0), atol=1e-12)


def test_a_path_goes_through_its_keyframes_at_one_speed(data):
    keys = [at(0, 1, 0), at(1, 1, 0.5, (1, 0, 0)), at(1.2, 2, 2, (0, -1, 1)), at(3, 1, 2)]
    cameras = along(data, *keys, frames=2000)
    assert [cameras[0].name, cameras[-1].name] == ["frame-0001", "frame-2000"]
    steps = np.linalg.norm(np.diff(places(cameras), axis=0), axis=1)
    assert steps.std() < 2e-3 * steps.mean()
    for key in keys:
        away = np.linalg.norm(places(cameras) - key["position"], axis=1)
        nearest = int(away.argmin())
        assert away[nearest] < steps[0]
        direction = np.subtract(key["target"], key["position"])
        cos = ahead(cameras)[nearest] @ direction / np.linalg.norm(direction)
        assert np.degrees(np.arccos(min(cos, 1))) < 0.5
    turns = np.degrees(np.arccos(np.clip((ahead(cameras)[1:] * ahead(cameras)[:-1]).sum(axis=1), -1, 1)))
    assert turns.max() < 0.5  # of 2000 frames: nowhere a jump
    bends = np.linalg.norm(np.diff(places(cameras), 2, axis=0), axis=1)
    assert bends.max() < 0.02 * steps.mean()  # ... nor a corner
    for camera in cameras[::100]:
        pose = camera.world_from_camera
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        assert pose[1, 0] == pytest.approx(0, abs=1e-12)  # level


def test_straight_down_from_above(data):
    """Where up tells no upper edge, a world axis does; on a path, the camera turns no more than it must."""
    (top,) = own_cameras(OwnCameras.model_validate({"look_at": {"top": at(2, 2.5, 2, (0, -1, 0))}}), data)
    np.testing.assert_allclose(top.world_from_camera[:3, :3], np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]), atol=1e-12)
    cameras = along(data, at(2, 2.5, 2, (0, -1, 0)), at(2, 1, 2, (1, 0, 0)))
    np.testing.assert_allclose(cameras[0].world_from_camera[:3, :3], top.world_from_camera[:3, :3], atol=1e-6)
    np.testing.assert_allclose(np.array([c.world_from_camera[1, 0] for c in cameras]), 0, atol=1e-6)


@pytest.mark.parametrize("timing", ["speed", "keyframes"])
@pytest.mark.parametrize("apart", [0, 0.005])
def test_a_camera_turns_no_faster_where_estimated_places_differ_a_little(data, apart, timing):
    """Two views of one tripod: its estimated places are some millimetres apart."""
    keys = [at(0, 1, 0, (1, 0, 0)), at(0, 1, apart, (0, 0, 1)), at(0, 1, 3, (0, 0, 1))]
    forward = ahead(along(data, *keys, frames=120, timing=timing))
    turns = np.degrees(np.arccos(np.clip((forward[1:] * forward[:-1]).sum(axis=1), -1, 1)))
    assert turns.max() < 5


def test_two_keyframes_are_a_straight_line(data):
    cameras = along(data, at(0, 1, 0), at(2, 1, 1), frames=5)
    np.testing.assert_allclose(places(cameras), np.linspace((0, 1, 0), (2, 1, 1), 5), atol=1e-9)
    assert len(along(data, at(0, 1, 0), at(2, 1, 1), frames=1)) == 1


def test_views_are_met_with_their_own_direction_and_roll(data):
    rolled = data.camera("b").world_from_camera
    cameras = along(data, "a", "b", "c", timing="keyframes")
    for camera, view in zip(cameras[::20], ("a", "b", "c"), strict=True):
        np.testing.assert_allclose(camera.world_from_camera, data.camera(view).world_from_camera, atol=1e-4)
    np.testing.assert_allclose(cameras[20].world_from_camera, rolled, atol=1e-4)


@pytest.mark.parametrize("turn", [(0.3, 0.2, 0.1), (2.9, -0.4, -1.2), (0.5, -np.pi / 2, 0), (0.7, np.pi / 2, 0)])
def test_any_direction_of_a_view_is_kept(data, turn):
    """Rolled, and straight down and up too, where heading and pitch tell too little."""
    from fipt.stages.render import cameras as module

    yaw, pitch, roll = turn
    rotation = Rotation.from_euler("YXZ", [yaw, pitch, roll]).as_matrix()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, (1, 2, 3)
    for up in (np.array([0, 1.0, 0]), np.array([0, 0, -1.0])):
        axes = module._axes(up)
        np.testing.assert_allclose(module._from_coordinates(module._coordinates(pose, axes), axes), pose, atol=1e-6)


def test_a_loop_closes_without_a_seam(data):
    corners = [at(0, 1, 0, (1, 0, 0)), at(2, 1, 0, (0, 0, 1)), at(2, 1, 2, (-1, 0, 0)), at(0, 1, 2, (0, 0, -1))]
    cameras = along(data, *corners, frames=80, loop=True)
    ring, directions = places([*cameras, *cameras[:2]]), ahead([*cameras, *cameras[:2]])
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    assert np.ptp(steps) < 0.01 * steps.mean()
    turned = np.degrees(np.arccos(np.clip((directions[1:] * directions[:-1]).sum(axis=1), -1, 1)))
    np.testing.assert_allclose(turned.sum() - turned[-1], 360, rtol=0.02)  # once around, never back
    assert turned.max() < 12


def test_a_turn_on_the_spot_stays_there(data):
    cameras = along(data, at(0, 1, 0), at(1, 1, 0), at(1, 1, 0, (1, 0, 0)), at(1, 1, 2, (1, 0, 0)), frames=201)
    here = np.linalg.norm(places(cameras) - (1, 1, 0), axis=1) < 1e-6
    assert here.sum() > 50
    directions = ahead(cameras)[here]
    assert directions[0] @ (0, 0, -1) > 0.999
    assert directions[-1] @ (1, 0, 0) > 0.999


def test_the_same_time_between_keyframes(data):
    keys = [at(0, 1, 0), at(0.5, 1, 0), at(3.5, 1, 0)]
    cameras = along(data, *keys, frames=21, timing="keyframes")
    np.testing.assert_allclose(cameras[10].center, (0.5, 1, 0), atol=1e-3)
    assert (np.diff(places(cameras)[:, 0]) > 0).all()


def test_the_same_keyframe_twice_is_a_pause(data):
    keys = [at(0, 1, 0), at(1, 1, 0), at(1, 1, 0), at(2, 1, 1)]
    cameras = along(data, *keys, frames=31, timing="keyframes")
    np.testing.assert_allclose(places(cameras)[10:21], np.tile((1.0, 1, 0), (11, 1)), atol=1e-6)
    moving = along(data, *keys, frames=31)
    steps = np.linalg.norm(np.diff(places(moving), axis=0), axis=1)
    assert np.ptp(steps) < 0.1 * steps.mean()  # the way has a corner there, across which it is shorter


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ('{"path": {"keyframes": ["a"], "frames": 3}}', "cameras.path.keyframes: tuple should have at least 2 items"),
        (
            '{"path": {"keyframes": ["a", "b"], "frames": 0}}',
            "cameras.path.frames: input should be greater than or equ",
        ),
        ('{"path": {"keyframes": ["a", {"position": [1, 2, 3]}], "frames": 3}}', "the name of a view, or position and"),
        ('{"look_at": {"x": {"position": [1, 1, 1], "target": [1, 1, 1]}}}', "position and target must be apart"),
        ('{"look_at": {"x": {"position": [1, 1, 1], "target": [1, 1, 0], "fov": 180}}}', "than or equal to 170"),
        ('{"look_at": {"x": {"position": [1, 1, NaN], "target": [1, 1, 0]}}}', "finite number"),
        ('{"look_at": {"x": {"position": [1, 1, 1], "target": [1, 1, 0], "fov": 9, "vertical_fov": 9}}}', "not both"),
        ('{"path": {"keyframes": ["a", "b"], "frames": 2, "up": [0, 0, 0]}}', "up must have a length"),
        ("{}", "cameras must have look_at or path, one of them"),
        ('{"look_at": {}}', "at least 1 item"),
        ("{", "cameras must be JSON"),
    ],
)
def test_what_is_no_camera(given, said):
    with pytest.raises(FiptError) as error:
        parse_cameras(given)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_what_only_the_dataset_tells(data):
    with pytest.raises(FiptError, match="goes through view 'bb', which there is not; use b"):
        along(data, "a", "bb")
    rejected = Dataset(data.root)
    rejected.rejected = {"b": "it is mirrored"}
    with pytest.raises(FiptError, match="goes through view b, which was rejected: it is mirrored"):
        along(rejected, "a", "b")
    with pytest.raises(FiptError, match="all the same"):
        along(data, "a", "a")
    own = OwnCameras.model_validate({"look_at": {"x": at(1, 1, 1)}})
    with pytest.raises(FiptError, match="has no camera y; its cameras: x"):
        chosen_cameras(own, data, ["y"])
    assert [camera.name for camera in chosen_cameras(own, data, [])] == ["x"]
    with pytest.raises(FiptError, match="cannot be used as a file name"):
        own_cameras(OwnCameras.model_validate({"look_at": {"../x": at(1, 1, 1)}}), data)
    with pytest.raises(ValidationError, match="renders none"):
        RelightSetup.model_validate({"cameras": own.model_dump(), "reference": "photos"})
