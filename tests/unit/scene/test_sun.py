"""The sun of an environment map."""

import numpy as np
import pytest

from fipt.scene.environment import EnvironmentMap, constant, solid_angles
from fipt.scene.sun import split, with_sun

TOWARD = np.array([0.3, 0.7, -0.6]) / np.linalg.norm([0.3, 0.7, -0.6])
POWER = np.array([9.0, 8.0, 6.0])


def given(environment):
    """(3,) what a map would give a sphere: radiance times solid angle of all texels."""
    angle = solid_angles(*environment.radiance.shape[:2])
    return (environment.radiance * angle[..., None]).sum(axis=(0, 1), dtype=np.float64)


def sky(up="y", rotation=0.0):
    rows = np.linspace(3, 1, 32, dtype=np.float32)[:, None, None]
    return EnvironmentMap("map", np.broadcast_to(rows, (32, 64, 3)).copy(), up, rotation)


@pytest.mark.parametrize(("up", "rotation"), [("y", 0.0), ("z", 30.0)])
@pytest.mark.parametrize("radius", [0.0, 0.3, 1.5])
def test_a_sun_that_is_added_is_found_again(up, rotation, radius):
    lit = with_sun(sky(up, rotation), TOWARD, POWER, np.radians(radius), 512)
    rest, sun = split(lit)
    middle = sun.chance @ sun.direction
    assert np.degrees(np.arccos(middle @ TOWARD / np.linalg.norm(middle))) < 0.3
    np.testing.assert_allclose(sun.irradiance.sum(axis=0), POWER, rtol=1e-3)
    np.testing.assert_allclose(given(rest) + sun.irradiance.sum(axis=0), given(lit), rtol=1e-5)
    assert rest.radiance.max() < 3.1
    # bilinear: the texels beside the disc have a share of it in pictures
    assert np.degrees(np.sqrt((np.pi * sun.radius**2).sum() / np.pi)) == pytest.approx(max(radius, 0.2), rel=0.3)


def test_directions_to_it_have_its_power_and_lie_on_it(np_rng):
    _, sun = split(with_sun(sky(), TOWARD, POWER, np.radians(1.5), 256))
    direction, arriving = sun.toward(*np_rng.random((3, 5000)))
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    np.testing.assert_allclose(arriving.mean(axis=0), POWER, rtol=0.02)
    away = np.degrees(np.arccos(np.clip(direction @ TOWARD, -1, 1)))
    assert away.max() < 2.2
    assert np.median(away) == pytest.approx(1.5 * np.sqrt(0.5), abs=0.15)


def test_what_is_even_or_large_is_no_sun():
    assert split(constant((5.0, 5.0, 5.0)))[1] is None
    assert split(sky())[1] is None
    window = sky()
    window.radiance[10:14, 20:24] = 500  # 22 degrees wide
    rest, sun = split(window)
    assert sun is None
    assert rest is window


def test_a_light_in_a_black_sky_is_one():
    radiance = np.zeros((512, 1024, 3), np.float32)
    radiance[100:103, 50:53] = 7
    rest, sun = split(EnvironmentMap("given", radiance))
    assert len(sun.radius) == 9
    assert not rest.radiance.any()
