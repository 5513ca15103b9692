"""The interior of a room and the quads in its openings."""

from __future__ import annotations

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.environment import EnvironmentMap, constant, texel_directions
from fipt.scene.mesh import Mesh

SIZE = np.array([4.0, 2.5, 3.0])


def boxes(*bounds) -> Mesh:
    """Solid boxes, each from (2, 3) bounds."""
    import trimesh

    made = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(b, float)) for b in bounds])
    return Mesh(made.vertices.astype(np.float32), made.faces.astype(np.int32))


def room(*more, window=True) -> Mesh:
    """Walls 0.2 m thick around 4 x 2.5 x 3 m; a window of 1.2 x 1 m in the wall at x = 0."""
    t = 0.2
    x, y, z = SIZE
    low, high = -t, SIZE + t
    walls = [
        [(low, low, low), (high[0], 0, high[2])],
        [(low, y, low), (high[0], high[1], high[2])],
        [(x, 0, low), (high[0], y, high[2])],
        [(0, 0, low), (x, y, 0)],
        [(0, 0, z), (x, y, high[2])],
    ]
    if window:  # z from 0.9 to 2.1, y from 0.8 to 1.8
        walls += [
            [(low, 0, low), (0, 0.8, high[2])], [(low, 1.8, low), (0, y, high[2])],
            [(low, 0.8, low), (0, 1.8, 0.9)], [(low, 0.8, 2.1), (0, 1.8, high[2])],
        ]  # fmt: skip
    return boxes(*walls, *more)


def pose(*place) -> np.ndarray:
    made = np.eye(4)
    made[:3, 3] = place
    return made


FURNITURE = ([(2.5, 0, 1), (3.5, 0.8, 2)], [(1, 0, 2.4), (1.8, 2.0, 3.0)])


@pytest.mark.parametrize("cameras", [[], [pose(1, 1.2, 1.0)]])
def test_the_box_is_that_of_the_walls(cameras, backend):
    from fipt.render.scene import RayScene
    from fipt.synthetic.scenefile.interior import find_interior

    # A backdrop outside and a ground plane: neither belongs to the room.
    mesh = room(*FURNITURE, [(-9, -0.3, -9), (-8.9, 6, 9)])
    found = find_interior(mesh, RayScene(mesh), cameras, "room")
    assert np.allclose(found.box, [[0, 0, 0], SIZE], atol=0.12)
    assert (found.points > found.box[0]).all()
    assert (found.points < found.box[1]).all()
    inside_table = ((found.points > [2.55, 0, 1.05]) & (found.points < [3.45, 0.75, 1.95])).all(axis=1)
    assert not inside_table.any()


def test_a_camera_before_a_missing_wall_finds_the_room_ahead(backend):
    from fipt.render.scene import RayScene
    from fipt.synthetic.scenefile.interior import find_interior

    camera = pose(-2.0, 1.2, 1.5)
    camera[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # looks along +x
    mesh = room(window=False)
    found = find_interior(mesh, RayScene(mesh), [camera], "room")
    assert np.allclose(found.box[1], SIZE, atol=0.12)
    assert found.box[0, 0] == pytest.approx(0, abs=0.4)


def test_a_camera_behind_a_wall_finds_the_room_and_is_told(backend, caplog):
    from fipt.render.scene import RayScene
    from fipt.synthetic.scenefile.interior import find_interior

    camera = pose(-2.0, 1.2, 1.5)
    camera[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # looks along +x, at the wall's back
    mesh = room([(-0.2, 0, 0), (0, SIZE[1], SIZE[2])], window=False)
    found = find_interior(mesh, RayScene(mesh), [camera], "room")
    assert np.allclose(found.box, [[0, 0, 0], SIZE], atol=0.12)
    assert "no camera of the file" in caplog.text


def test_outdoors_is_said(backend):
    from fipt.render.scene import RayScene
    from fipt.synthetic.scenefile.interior import find_interior

    garden = boxes([(-5, -0.1, -5), (5, 0, 5)], [(0, 0, 0), (1, 1, 1)])
    with pytest.raises(FiptError, match=r"garden has no interior: .*outdoors"):
        find_interior(garden, RayScene(garden), [pose(0, 1.5, 3)], "garden")


def closed(mesh: Mesh, outside: EnvironmentMap):
    from fipt.render.scene import RayScene
    from fipt.synthetic.scenefile.interior import close_openings, find_interior

    scene = RayScene(mesh)
    return close_openings(scene, find_interior(mesh, scene, [pose(2, 1.2, 1.5)], "room"), outside, "room")


def test_a_window_is_closed_by_one_quad_with_the_radiance_outside(backend):
    openings, leaving = closed(room(*FURNITURE), constant((3.0, 2.0, 1.0)))
    assert len(openings) == 1
    assert leaving < 1e-3
    corners = openings[0].corners
    assert np.allclose(corners.min(axis=0), [corners[0, 0], 0.8, 0.9], atol=0.08)
    assert np.allclose(corners.max(axis=0), [corners[0, 0], 1.8, 2.1], atol=0.08)
    assert -0.3 < corners[0, 0] < 0.02
    assert np.cross(corners[1] - corners[0], corners[2] - corners[0])[0] > 0  # shines into the room
    share = openings[0].radiance / [3, 2, 1]  # the reveal of the window takes some light away
    assert np.ptp(share) < 1e-3
    assert 0.6 < share[0] <= 1.001


def test_what_comes_in_is_weighed_by_its_cosine(backend):
    # In a wall without thickness. Light from everywhere: all of it; from above the horizon: half; from a cone of 30
    # degrees around -x: sin^2(30 degrees).
    directions = texel_directions(64, 128)
    cases = {1.0: directions[:, 1] > -2, 0.5: directions[:, 1] > 0, 0.25: -directions[:, 0] > np.cos(np.radians(30))}
    for expected, lit in cases.items():
        radiance = np.repeat(lit[:, None], 3, axis=1).reshape(64, 128, 3).astype(np.float32)
        openings, _ = closed(thin(), EnvironmentMap("given", radiance))
        assert openings[0].radiance[0] == pytest.approx(expected, abs=0.03)


def thin() -> Mesh:
    """The room with a window in a wall without thickness."""
    mesh = room(window=False)
    frame = [((0, 0.8), (0, 3)), ((1.8, 2.5), (0, 3)), ((0.8, 1.8), (0, 0.9)), ((0.8, 1.8), (2.1, 3))]
    vertices, triangles = [mesh.vertices], [mesh.triangles]
    for (y0, y1), (z0, z1) in frame:
        triangles.append(np.array([(0, 1, 2), (0, 2, 3)]) + sum(map(len, vertices)))
        vertices.append(np.array([(0, y0, z0), (0, y1, z0), (0, y1, z1), (0, y0, z1)]))
    return Mesh(np.concatenate(vertices).astype(np.float32), np.concatenate(triangles).astype(np.int32))


def test_a_room_full_of_holes_is_refused(backend, monkeypatch):
    from fipt.synthetic.scenefile import interior

    monkeypatch.setattr(interior, "_MOST_QUADS", 0)
    with pytest.raises(FiptError, match=r"more than a few openings .*environment: keep"):
        closed(room(), constant((1, 1, 1)))
