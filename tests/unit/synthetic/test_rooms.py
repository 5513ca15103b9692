"""All rooms in code: closed, apart, inside the model, with complete truth and cameras in free space."""

from typing import get_args

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.synthetic.dataset import write_images, write_room
from fipt.synthetic.poses import OpenSpace, sample_cameras
from fipt.synthetic.room import build
from fipt.synthetic.rooms import ROOMS
from fipt.synthetic.settings import RoomName, SynthesizeSettings

SKY = (8.0, 9.75, 12.5)
OTHERS = sorted(set(ROOMS) - {"living_room"})


@pytest.fixture(params=OTHERS)
def room(request):
    return build(0, False, SKY, request.param)


def surface(room, count, rng):
    """Random points on a room, evenly by the root of the area, with their triangles and normals."""
    share = np.sqrt(room.mesh.areas)
    triangle = rng.choice(len(share), count, p=share / share.sum())
    weights = rng.dirichlet((1, 1, 1), count)
    points = (room.mesh.corners[triangle] * weights[..., None]).sum(axis=1)
    return points, triangle, room.mesh.normals[triangle]


def test_every_room_can_be_chosen():
    assert set(ROOMS) == set(get_args(RoomName))


def test_materials_are_inside_the_model(room):
    assert room.mesh.areas.min() > 1e-7
    assert len(set(room.parts)) == len(room.parts)
    for material in room.materials:
        assert material.roughness.min() >= 0.02
        assert material.roughness.max() <= 1
        assert set(np.unique(material.metallic)) <= {0, 1}
        assert material.base_color.min() >= 0
        assert material.base_color.max() < 0.9


def test_it_is_closed_and_its_shell_faces_inward(room, backend, np_rng):
    from fipt.synthetic.views import Truth

    truth = Truth(room)
    space = OpenSpace(room, truth.intersect, 0)
    direction = np_rng.standard_normal((4000, 3))
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    shell = [i + 1 for i, name in enumerate(room.parts) if name.endswith(" wall") or name in ("floor", "ceiling")]
    for place in space.places[::32]:
        distance, triangle = truth.intersect(np.broadcast_to(place, direction.shape), direction)
        assert (triangle >= 0).all()
        assert (distance < np.linalg.norm(room.box[1]) + 1).all()
        facing = -(room.mesh.normals[triangle] * direction).sum(axis=1)
        assert (facing[np.isin(room.part[triangle], shell) | room.emits[triangle]] > 0).all()


def test_no_surfaces_of_two_parts_coincide(room, backend, np_rng):
    from fipt.synthetic.views import Truth

    points, triangle, normal = surface(room, 20_000, np_rng)
    off = 2e-4
    distance, met = Truth(room).intersect((points + off * normal).astype(np.float32), -normal.astype(np.float32))
    others = (met >= 0) & (distance < 2 * off) & (room.part[met] != room.part[triangle])
    assert others.mean() < 1e-3  # where pieces cut each other


def test_nothing_stands_beyond_the_walls(room):
    low, high = room.mesh.vertices.min(axis=0), room.mesh.vertices.max(axis=0)
    assert (low >= room.box[0] - [0.36, 1e-6, 0.36]).all()  # recesses of windows
    assert (high <= room.box[1] + [0.36, 0.36, 0.36]).all()


def test_views_have_light_and_complete_truth(room, backend, tmp_path):
    from fipt.scene.dataset import Dataset

    settings = SynthesizeSettings(
        room=room.facts["room"], train_views=3, val_views=1, width=32, height=24, spp=8, denoise=False
    )
    write_room(tmp_path, settings)
    write_images(tmp_path, ["train_000", "val_000"], settings)
    dataset = Dataset(tmp_path)
    for view in ("train_000", "val_000"):
        assert 0.02 < np.median(dataset.image(view)[0]) < 3
        truth = dataset.truth(view)
        assert set(truth) == {
            "kd", "base_color", "reflectance", "emission", "roughness", "metallic", "emission_mask",
        }  # fmt: skip
        assert all(np.isfinite(layer).all() for layer in truth.values())
        assert (dataset.segments(view, "part") > 0).all()


def test_the_skylight_is_in_no_view(backend):
    from fipt.synthetic.views import Truth, view_truth

    room = build(0, False, SKY, "skylight")
    truth = Truth(room)
    cameras = sample_cameras(OpenSpace(room, truth.intersect, 0), SynthesizeSettings(train_views=8, val_views=2))
    assert room.unseen == tuple(room.parts[room.part[triangles[0]] - 1] for triangles in room.emitters)
    for camera in cameras:
        assert not view_truth(truth, camera).layers["emission"].any()


def test_cameras_that_walk_may_not_show_it_either(backend):
    from fipt.synthetic.views import Truth

    room = build(0, False, SKY, "skylight")
    space = OpenSpace(room, Truth(room).intersect, 0)
    with pytest.raises(FiptError, match="window pane skylight"):
        sample_cameras(space, SynthesizeSettings(train_views=12, val_views=2, cameras="walk", fov=140))


def test_blinds_hide_most_of_their_window(backend, np_rng):
    from fipt.synthetic.poses import visible
    from fipt.synthetic.views import Truth

    room = build(0, False, SKY, "blinds")
    intersect = Truth(room).intersect
    pane = np.flatnonzero(room.emits)
    points = room.mesh.corners[np_rng.choice(pane, 4000)]
    points = (points * np_rng.dirichlet((1, 1, 1), 4000)[..., None]).sum(axis=1).astype(np.float32)
    eyes = np.tile(np.array([3.2, 1.5, 4.4], np.float32), (len(points), 1))
    assert 0.1 < visible(eyes, points, intersect).mean() < 0.5


def test_a_screen_shows_a_picture_of_several_radiances():
    room = build(0, False, SKY, "office")
    names = [emitter["part"] for emitter in room.description()["emitters"]]
    assert names.count("presentation") > 4
    radiance = room.radiance[room.emits].max(axis=1)
    assert radiance.max() / radiance.min() > 20


def test_a_room_without_a_window_cannot_be_opened():
    assert not build(0, True, SKY, "blinds").emits.any()
