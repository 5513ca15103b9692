"""The sun at points of the surface."""

import numpy as np
import pytest

from tests import scenes

POWER = np.array([np.pi, 2 * np.pi, 0.0])


@pytest.fixture
def found(backend):
    """(3, 3) light on the floor beside a wall 1 m high, from a sun 45 degrees high behind it: at 0.5, 0.999 and 2 m."""
    from fipt.render.scene import RayScene
    from fipt.render.sunlight import sunlight
    from fipt.scene.sun import Sun

    mesh = scenes.joined(scenes.floor(), scenes.quad((-4, 0, 0), (8, 0, 0), (0, 1, 0)))
    toward = np.array([[0, 1, -1]]) / np.sqrt(2)
    sun = Sun(toward, POWER[None], np.radians([0.5]))
    place = np.array([[0, 0, 0.5], [0, 0, 0.999], [0, 0, 2.0]])
    return sunlight(RayScene(mesh), sun, place, np.tile([0.0, 1, 0], (3, 1)))


def test_it_is_the_cosine_times_its_irradiance(found):
    np.testing.assert_allclose(found[2], POWER / np.pi * np.sqrt(0.5), rtol=5e-3)


def test_a_wall_throws_a_shadow_with_a_soft_border(found):
    assert not found[0].any()
    assert 0.2 < found[1, 0] / found[2, 0] < 0.8
