"""What makes a camera believable: shared points, agreement of two mappings, links, parallax."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fipt.stages.poses.evidence import Agreement, agreement, groups, judged, of_one_place, shared_points
from fipt.stages.poses.matching import Link
from fipt.stages.poses.model import Reconstruction, Tracks
from fipt.stages.poses.settings import PosesSettings
from tests import painted_room

SETTINGS = PosesSettings()


def scene(cameras, seen):
    """A reconstruction in which camera i sees the points seen[i]; they fill the room."""
    count = 1 + max(max(points) for points in seen)
    view = np.concatenate([np.full(len(points), i) for i, points in enumerate(seen)])
    point = np.concatenate([np.array(points) for points in seen])
    places = np.random.default_rng(0).uniform(0, painted_room.SIZE, (count, 3))
    pixels = np.zeros((len(view), 2), np.float32)
    return Reconstruction(tuple(cameras), places, np.full(count, 0.4, np.float32), Tracks(view, point, pixels))


def all_agree(model):
    return {camera.name: Agreement(0.0, 0.0) for camera in model.cameras}


def test_shared_points_are_counted_once():
    tracks = Tracks(np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 1, 1, 2, 2]), np.zeros((6, 2), np.float32))
    assert shared_points(tracks, 4).tolist() == [[2, 1, 0, 0], [1, 2, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0]]


def test_groups_are_held_by_strong_links_only():
    strength = np.zeros((5, 5), int)
    strength[0, 1] = strength[1, 0] = strength[2, 3] = strength[3, 2] = strength[3, 4] = strength[4, 3] = 30
    strength[1, 2] = strength[2, 1] = 12
    assert [group.tolist() for group in groups(strength, 20)] == [[2, 3, 4], [0, 1]]
    assert [group.tolist() for group in groups(strength, 12)] == [[0, 1, 2, 3, 4]]


def test_two_mappings_are_compared_up_to_a_similarity():
    cameras = painted_room.ring(8)
    model = scene(cameras, [range(40)] * 8)
    turned = cameras[3].world_from_camera.copy()
    turned[:3, :3] = turned[:3, :3] @ Rotation.from_euler("y", 5, degrees=True).as_matrix()
    shifted = cameras[6].world_from_camera.copy()
    shifted[:3, 3] += (0.2, 0, 0)
    other = [replace(camera, world_from_camera=camera.world_from_camera.copy()) for camera in cameras]
    other[3], other[6] = replace(cameras[3], world_from_camera=turned), replace(cameras[6], world_from_camera=shifted)
    found = agreement(model, replace(model, cameras=tuple(other)), SETTINGS)
    assert found["view_03"].turn == pytest.approx(5, abs=1e-6)
    size = np.linalg.norm(np.subtract(*np.percentile(model.points, (98, 2), axis=0)))
    assert found["view_06"].shift == pytest.approx(0.2 / size, rel=1e-6)
    assert max(a.shift for name, a in found.items() if name != "view_06") < 1e-9
    assert agreement(model, None, SETTINGS) == {}


def test_a_group_that_a_few_points_hold_is_not_believed():
    """Two rooms merged into one model by chance matches: fine reprojection errors, and eight points between them."""
    cameras = painted_room.ring(5, prefix="a") + painted_room.ring(4, prefix="b")
    seen = [range(60)] * 5 + [[*range(52, 60), *range(100, 160)]] * 4
    model = scene(cameras, seen)
    names = [camera.name for camera in cameras]
    found = judged(names, np.full(9, 900), [], [model], all_agree(model), [], SETTINGS)
    assert [found[name].reason for name in names[:5]] == [None] * 5
    for name in names[5:]:
        assert (
            "weakly linked: no other view shares 20 points with its group of 4 views; the most is 8"
            in found[name].reason
        )
    assert found["a_00"].neighbours == ("a_01", "a_02", "a_03", "a_04")


def test_every_reason_is_said():
    cameras = painted_room.ring(6)
    model = scene(cameras[:5], [range(60), range(60), range(60), range(60), range(25)])
    errors = model.errors.copy()
    second = painted_room.ring(3, prefix="far")
    names = [camera.name for camera in cameras] + [camera.name for camera in second]
    agreements = all_agree(model) | {"view_02": Agreement(0.03, 0.2)}
    del agreements["view_03"]
    links = [Link((0, 5), 20, np.ones(20)), Link((6, 7), 90, np.ones(90))]
    features = np.array([900] * 6 + [900, 900, 12])
    other = scene(second[:2], [range(40)] * 2)
    found = judged(names, features, links, [model, other], agreements, [], SETTINGS)
    reasons = {name: evidence.reason for name, evidence in found.items()}
    assert reasons["view_00"] is None
    assert reasons["view_02"] == "two mappings disagree: 3.0% of the scene's extent, 0.20 degrees apart"
    assert reasons["view_03"] == "only one of two mappings has placed it"
    assert reasons["view_04"] == "only 25 points hold its pose; 30 are needed"
    assert reasons["view_05"] == "no pose: its matches with view_00 do not determine it"
    assert reasons["far_00"] == "no pose: part of a group of 2 views that is not linked with the others"
    assert "12 features" in reasons["far_02"]
    blurred = judged(names, features, links, [replace(model, errors=errors * 9)], agreements, [], SETTINGS)
    assert "reprojection error 3.60 pixels" in blurred["view_00"].reason


def test_a_turning_camera_is_known_by_its_matches():
    still, moved = np.full(50, 0.1), np.full(50, 2.0)
    assert of_one_place([Link((0, 1), 50, still)] * 9 + [Link((1, 2), 50, moved)], 1.0)
    assert not of_one_place([Link((0, 1), 50, still)] * 8 + [Link((1, 2), 50, moved)] * 2, 1.0)
    assert not of_one_place([], 1.0)
