"""Objects in their places: turned, scaled, dropped onto the room and onto one another."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.mesh import write_ply
from fipt.scene.setup import RelightSetup
from tests import scenes

TABLE = scenes.joined(scenes.box((0, 0, 0), (4, 3, 5)), scenes.turned(scenes.box((1, 0, 1), (2, 0.75, 2))))
HANGING = scenes.joined(TABLE, scenes.turned(scenes.box((2.9, 0.0, 2.9), (3.1, 1.0, 3.1))))
"""With a post that is thinner than what falls onto it."""


@pytest.fixture
def put(backend):
    from fipt.render.objects import objects_in

    def put(*entries, room=TABLE, up="y"):
        return objects_in(room, RelightSetup.model_validate({"objects": entries}).objects, up)

    return put


def cube(x, y, z, **keys):
    return {"shape": "cube", "size": 0.4, "position": [x, y, z], **keys}


@pytest.mark.parametrize(
    ("room", "place", "floor"),
    [
        (TABLE, (3, 2, 3), 0.0),  # corners onto the floor
        (TABLE, (1.5, 2, 1.5), 0.75),  # onto the table
        (TABLE, (1.9, 2, 2.1), 0.75),  # over its edge: one corner meets it, or its edge the cube
        (HANGING, (3, 2, 3), 1.0),  # no corner of the cube is above the post: its corners meet the cube
        (TABLE, (3, 0.1, 3), None),  # stands in the floor: stays where it is
    ],
)
def test_dropped_objects_touch_what_is_below(put, room, place, floor):
    (thing,) = put(cube(*place, drop=True), room=room)
    low = thing.mesh.vertices[:, 1].min()
    if floor is None:
        assert low == pytest.approx(place[1] - 0.2, abs=1e-3) or low < 1e-3
    else:
        assert floor < low < floor + 0.002
    np.testing.assert_allclose(thing.mesh.vertices.mean(axis=0)[[0, 2]], [place[0], place[2]], atol=1e-5)


def test_objects_fall_onto_those_before(put):
    first, second = put(cube(3, 1, 3, drop=True), cube(3.1, 2, 3.1, rotation=[0, 45, 0], drop=True))
    assert first.mesh.vertices[:, 1].max() == pytest.approx(0.4, abs=0.002)
    assert second.mesh.vertices[:, 1].min() == pytest.approx(0.4, abs=0.004)


def test_objects_fall_through_what_was_removed(put):
    from fipt.render.edits import without

    post = np.arange(len(HANGING.triangles)) >= len(TABLE.triangles)
    (thing,) = put(cube(3, 2, 3, drop=True), room=without(HANGING, post))
    assert thing.mesh.vertices[:, 1].min() == pytest.approx(0, abs=0.002)


def test_a_corner_falls_first(put):
    (thing,) = put(cube(3, 2, 3, rotation=[45, 0, 0], drop=True))
    assert thing.mesh.vertices[:, 1].min() == pytest.approx(0, abs=0.002)
    assert np.ptp(thing.mesh.vertices[:, 1]) == pytest.approx(0.4 * np.sqrt(2), rel=1e-4)


def test_up_may_be_z(put):
    (thing,) = put(cube(3, 2, 3, drop=True), up="z")
    assert thing.mesh.vertices[:, 2].min() == pytest.approx(0, abs=0.002)


def test_nothing_below_is_an_error(put):
    with pytest.raises(FiptError, match=r"objects\.0 cannot be dropped: nothing is below it"):
        put(cube(9, 2, 9, drop=True))


def test_rotation_is_about_x_then_y_then_z(put, tmp_path):
    """About x: y to z; then about y: z to x; then about z: x to y."""
    mesh = scenes.Mesh(np.float32([[0, 0, 0], [0, 1, 0], [0, 0, 1]]), np.int32([[0, 1, 2]]))
    write_ply(tmp_path / "a.ply", mesh)
    entry = {"file": str(tmp_path / "a.ply"), "position": [1, 2, 3], "scale": 2}
    for rotation, tip in (((90, 0, 0), (0, 0, 2)), ((90, 90, 0), (2, 0, 0)), ((90, 90, 90), (0, 2, 0))):
        (thing,) = put(entry | {"rotation": rotation})
        np.testing.assert_allclose(thing.mesh.vertices[1], np.add(tip, (1, 2, 3)), atol=1e-5)


def test_barycentric_weights(backend, np_rng):
    from fipt.render.objects import barycentric

    corners = np_rng.normal(size=(50, 3, 3))
    weights = np_rng.dirichlet(np.ones(3), 50)
    points = np.einsum("nk,nkc->nc", weights, corners)
    np.testing.assert_allclose(barycentric(corners, points), weights, atol=1e-8)
    beyond = corners[:, 0] + 3 * (corners[:, 0] - corners[:, 1])
    found = barycentric(corners, beyond)
    assert found.min() >= 0
    np.testing.assert_allclose(found.sum(axis=1), 1)
