"""A sun that no pixel sees, told by where it shines in a room with one window."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from fipt.scene.environment import EnvironmentMap, texel_directions
from fipt.scene.mesh import Mesh
from fipt.scene.surface_blocks import Blocks
from fipt.stages.environment.settings import FittedMap
from fipt.stages.environment.unseen import RoomLight
from tests import scenes

TOWARD = np.array([0.25, 0.55, -0.8]) / np.linalg.norm([0.25, 0.55, -0.8])
POWER = np.array([9.0, 7.5, 6.0])
LIGHT = np.array([0.5, 0.45, 0.4])
SIDE = 36


def walls() -> Mesh:
    """A room of 4 m x 2.5 m x 4 m, with an opening of 1.2 m x 1.3 m in the wall z = 0."""
    shell = scenes.box((0, 0, 0), (4, 2.5, 4))
    wall = np.isclose(shell.corners[..., 2], 0).all(axis=1)
    return scenes.joined(
        Mesh(shell.vertices, shell.triangles[~wall]),
        scenes.quad((0, 0, 0), (4, 0, 0), (0, 0.8, 0)),
        scenes.quad((0, 2.1, 0), (4, 0, 0), (0, 0.4, 0)),
        scenes.quad((0, 0.8, 0), (1.4, 0, 0), (0, 1.3, 0)),
        scenes.quad((2.6, 0.8, 0), (1.4, 0, 0), (0, 1.3, 0)),
    )


def pieces(np_rng, points):
    """Blocks of the floor and of two walls, with K points each: positions (N, K, 3), normals, and their surface."""
    step = (np.arange(SIDE) + 0.5) / SIDE
    u, v = (each.ravel() for each in np.meshgrid(step, step))
    zero = np.zeros_like(u)
    parts = [
        (np.stack([4 * u, zero, 4 * v], 1), (0, 1, 0)),
        (np.stack([zero, 2.5 * u, 4 * v], 1), (1, 0, 0)),
        (np.stack([zero + 4, 2.5 * u, 4 * v], 1), (-1, 0, 0)),
    ]
    group = np.repeat(np.arange(3), SIDE * SIDE)
    normal = np.repeat(np.float32([each for _, each in parts]), SIDE * SIDE, axis=0)
    place = np.concatenate([each for each, _ in parts])[:, None]
    inside = np_rng.uniform(-0.5, 0.5, (len(place), points, 3)) * 4 / SIDE * (normal == 0)[:, None]
    place = np.clip(place + inside, (0, 0, 0.001), (4, 2.5, 4)).astype(np.float32)
    return place, np.repeat(normal[:, None], points, axis=1), group


@pytest.fixture
def room(backend, np_rng):
    """Returns a search in the room (or its blocks), and the light that is known.

    ``power`` is that of its sun; what it lights is ``off`` metres from where the mesh says, and with ``rug`` a part of
    its own.
    """
    from fipt.render.scene import RayScene
    from fipt.render.sunlight import sunlight
    from fipt.scene.sun import Sun
    from fipt.stages.environment.sun import SunSearch

    def made(power, search=True, off=0.0, points=4, rug=False):
        scene = RayScene(walls())
        place, normal, group = pieces(np_rng, points)
        sun = Sun(TOWARD[None], np.asarray(power)[None], np.radians([0.27]))
        known = np.tile(LIGHT, (len(place), 1))
        light = known + np.mean(
            [sunlight(scene, sun, place[:, k] + np.float32([off, 0, 0]), normal[:, k]) for k in range(points)], axis=0
        )
        rho = np.array([[0.5, 0.3, 0.2], [0.7, 0.7, 0.7], [0.3, 0.4, 0.5]])[group]
        # the surface mirrors more of the room than of the sun
        color = (rho * light + 0.02 * known) * np.exp(0.25 * np_rng.standard_normal((len(place), 1)))
        none = np.zeros(len(place))
        group = group + 3 * (rug & (light > known).any(axis=1))
        blocks = Blocks(place, normal, color, none, group, none.astype(np.int64))
        return SunSearch(scene, blocks) if search else blocks, known

    return made


class Walls:
    """A dataset of nothing but a mesh."""

    @staticmethod
    def mesh() -> Mesh:
        return walls()


NOWHERE = EnvironmentMap("map", np.zeros((90, 180, 3), np.float32))
"""No pixel looks outside."""


def test_its_place_and_power_are_found(room):
    search, known = room(POWER)
    sun = search.find(known, NOWHERE)
    assert np.degrees(np.arccos(sun.direction @ TOWARD)) < 1
    np.testing.assert_allclose(sun.irradiance, POWER, rtol=0.15)
    assert sun.radius < np.radians(1)


def test_borders_that_are_off_do_not_tell_its_power(room, monkeypatch):
    from fipt.stages.environment import sun

    search, known = room(POWER, off=0.04, points=16)
    found = search.measured(known, TOWARD).irradiance
    np.testing.assert_allclose(found, POWER, rtol=0.12)
    monkeypatch.setattr(sun, "_ENOUGH", np.inf)
    assert (search.measured(known, TOWARD).irradiance < 0.95 * found).all()


def test_borders_tell_its_power_where_nothing_else_does(room):
    """What it lights is a part of its own, as a rug: dark at its border alone."""
    search, known = room(POWER, points=16, rug=True)
    np.testing.assert_allclose(search.measured(known, TOWARD).irradiance, POWER, rtol=0.3)


def test_where_it_stands_is_told_closely(room):
    search, known = room(POWER)
    begin = TOWARD + 0.012 * np.cross(TOWARD, [0, 1, 0])
    begin /= np.linalg.norm(begin)
    assert 0.5 < np.degrees(np.arccos(begin @ TOWARD)) < 0.7
    assert np.degrees(np.arccos(min(search.exact(known, begin, NOWHERE) @ TOWARD, 1))) < 0.25


def test_a_sun_is_not_sought_where_pixels_look(room):
    search, known = room(POWER)
    above = (np.arange(90) < 45).astype(np.float32)[:, None, None]
    assert search.find(known, EnvironmentMap("map", np.broadcast_to(above, (90, 180, 3)).copy())) is None


def test_nor_close_beside_where_one_would_be(room):
    """A small piece of the sky around it is looked at."""
    search, known = room(POWER)
    directions = texel_directions(90, 180)
    looked = (directions @ TOWARD > np.cos(np.radians(5))).astype(np.float32).reshape(90, 180, 1)
    seen = EnvironmentMap("map", np.repeat(looked, 3, axis=2))
    found = search.find(known, seen)
    assert found is None or seen.lookup(found.direction[None])[0, 0] < 0.5


def test_without_a_sun_none_is_found(room):
    search, known = room(np.full(3, 1e-9))
    assert search.find(known, NOWHERE) is None


def test_no_sun_stands_below_the_horizon(room):
    search, known = room(POWER)
    upside = EnvironmentMap("map", NOWHERE.radiance, "z", 20.0)  # up is +z, and the light comes from -z
    assert search.find(known, upside) is None


@pytest.mark.parametrize("sought", [True, False])
def test_the_sky_is_found_beside_the_sun(room, monkeypatch, sought):
    """Without the sun as such, the sky takes up its light: what it lights sees a piece of the sky there."""
    from fipt.stages.environment import from_room

    blocks, known = room(POWER, search=False)
    lit = np.log(blocks.radiance[:, 0]) > np.median(np.log(blocks.radiance[:, 0])) + 1
    open_ = np.zeros((len(known), 32 * 64))
    open_[lit, 5 * 64 + 36] = 0.02
    monkeypatch.setattr(from_room, "before_shading", lambda *_: None)
    monkeypatch.setattr(from_room, "blocks_of", lambda *_: blocks)
    monkeypatch.setattr(from_room, "room_light", lambda *_: RoomLight(known, csr_matrix(open_)))
    below = texel_directions(16, 32)
    below = below[below[:, 1] < -0.3]
    pixels = (below, np.full((len(below), 3), 0.5), np.ones(len(below)), np.zeros(len(below), bool))
    found = from_room.outside_from_room(Walls(), [], {}, pixels, FittedMap(sun=sought))
    assert found.sky.radiance.shape == (32, 64, 3)
    if not sought:
        assert found.sun is None
        assert "sun" not in found.figures
        assert found.sky.radiance.max() > 35
        return
    assert np.degrees(np.arccos(found.sun.direction @ TOWARD)) < 1
    assert found.figures["sun"]["irradiance"] == found.sun.irradiance.tolist()
    assert found.sky.radiance.max() < 20
