"""Fitting the light from outside to pixels that see no surface."""

import numpy as np
import pytest

from fipt.conventions import FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.manifests import Stats
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.environment import EnvironmentMap, pixel_directions, texel_directions
from fipt.stages.environment.directional import directional_mean, filled
from fipt.stages.environment.fit import find_environment
from fipt.stages.environment.settings import AutoEnvironment, ConstantEnvironment, FittedMap, NoEnvironment
from tests import scenes


def gradient(directions):
    """A smooth radiance of directions, brighter to the right and above."""
    return np.stack([2 + directions[:, 0], 2 + directions[:, 1], np.zeros(len(directions))], axis=1)


def looking(number, turns=12):
    """A camera at the origin that looks around horizontally."""
    angle = 2 * np.pi * number / turns
    return scenes.look_at(f"v{number}", (0, 0, 0), (np.sin(angle), 0.2, -np.cos(angle)), width=24, height=16, focal=14)


@pytest.fixture
def outdoors(tmp_path):
    """Writes views of a sky and returns the dataset and their samples; ``covered`` (H, W) says where the
    mesh stands in front of it. Every second view is clipped at ``limit``."""

    def made(covered, radiance=gradient, views=12, valid=None, limit=np.inf):
        cameras, samples, images = [looking(k) for k in range(views)], [], tmp_path / "images"
        write_transforms(tmp_path / "transforms.json", cameras)
        some = np.asarray(covered).ravel() > 0
        for camera in cameras:
            image = radiance(pixel_directions(camera, np.arange(24 * 16)))
            image[some] = 100.0  # the mesh's radiance, which must not count
            channels = {"": image.reshape(16, 24, 3)} | ({} if valid is None else {"valid.Y": valid})
            if np.isfinite(limit) and len(samples) % 2:
                clipped = channels[""].max(axis=-1) > limit
                channels |= {"": np.minimum(channels[""], limit), "flags.Y": np.float32(FLAG_SATURATED * clipped)}
            write_exr(images / f"{camera.name}.exr", channels)
            weight = np.ravel(covered)[some]
            samples.append(scenes.samples_of(np.zeros((some.sum(), 3)), 0, weight, some, (camera.name,), [(16, 24)]))
        return Dataset(tmp_path), samples

    return made


def environment(*given):
    """What is found without a look at the room."""
    return find_environment(*given, lambda: pytest.fail("needs no cache"))


OPEN, NOT_CLIPPED = np.zeros((16, 24)), np.zeros(128, bool)
MODES = {"map": FittedMap(unseen="smooth"), "constant": ConstantEnvironment(), "auto": AutoEnvironment(unseen="smooth")}


def test_map_of_what_is_seen(outdoors):
    stats = Stats()
    found = environment(*outdoors(OPEN), FittedMap(resolution=16, unseen="smooth"), stats)
    assert (found.mode, found.radiance.shape) == ("map", (16, 32, 3))
    assert 0.3 < stats["seen_directions"] < 0.9
    directions = texel_directions(16, 32)
    seen = np.abs(directions[:, 1] - 0.1) < 0.4
    got = found.lookup(directions)
    np.testing.assert_allclose(got[seen], gradient(directions)[seen], atol=0.06)
    # what is not seen continues it, within what is seen
    assert (got[:, 2] == 0).all()
    assert got[:, :2].min() > 0.9
    assert got[:, :2].max() < 3.1
    assert got[directions[:, 1] > 0.9, 1].mean() > got[directions[:, 1] < -0.9, 1].mean() + 0.3


@pytest.mark.parametrize("up", ["y", "z"])
def test_the_axis_of_a_fitted_map_does_not_matter_to_lookups(outdoors, up):
    found = environment(*outdoors(OPEN), FittedMap(resolution=16, up=up, unseen="smooth"), Stats())
    ahead = np.array([[0.1, 0.1, -0.99], [0.99, 0.1, 0.1], [-0.99, 0.05, 0.1]])
    np.testing.assert_allclose(found.lookup(ahead), gradient(ahead), atol=0.08)


def test_constant_is_the_mean_over_directions(outdoors):
    found = environment(*outdoors(OPEN), ConstantEnvironment(), Stats())
    assert (found.mode, found.radiance.shape) == ("constant", (1, 1, 3))
    np.testing.assert_allclose(found.mean, [2, 2.15, 0], atol=0.1)
    # a direction that many pixels see weighs no more: only its own views are repeated
    stated = environment(*outdoors(OPEN), ConstantEnvironment(radiance=(1, 2, 3)), Stats())
    np.testing.assert_allclose(stated.mean, [1, 2, 3], rtol=1e-6)


def test_holes_of_a_scan_and_invalid_pixels_do_not_count(outdoors):
    covered, valid = np.ones((16, 24)), np.ones((16, 24))
    covered[2:4, 3:5] = 0  # a small hole
    covered[8:14, 10:20] = 0
    valid[8:14, 10:15] = 0

    def two(directions):
        radiance = np.ones((len(directions), 3))
        radiance[np.flatnonzero((covered == 0).ravel() & (np.indices((16, 24))[0].ravel() < 5))] = 50
        radiance[np.flatnonzero(valid.ravel() == 0)] = 60
        return radiance

    for mode in ("map", "constant", "auto"):
        found = environment(*outdoors(covered, two, valid=valid), MODES[mode], Stats())
        np.testing.assert_allclose(found.radiance, 1, rtol=1e-5)
        assert found.known


@pytest.mark.parametrize("hole", [0, 2])
def test_a_closed_room_has_no_outside(outdoors, hole):
    covered = np.ones((16, 24))
    covered[4 : 4 + hole, 4 : 4 + hole] = 0
    data = outdoors(covered)
    found = environment(*data, AutoEnvironment(), Stats())
    assert not found.known
    assert not found.emits
    for mode in ("map", "constant"):
        with pytest.raises(FiptError, match=f"environment.mode {mode} needs training pixels that see no surface"):
            environment(*data, MODES[mode], Stats())
    assert not environment(*data, NoEnvironment(), Stats()).known
    for settings in (AutoEnvironment(up="z"), NoEnvironment(up="z")):
        assert environment(*data, settings, Stats()).up == "z"


@pytest.mark.parametrize("mode", ["map", "constant", "auto"])
def test_clipped_sky_is_no_darker_than_what_other_views_measure(outdoors, mode):
    data = outdoors(OPEN, lambda directions: np.full((len(directions), 3), 20.0), limit=10.0)
    np.testing.assert_allclose(environment(*data, MODES[mode], Stats()).mean, 20, rtol=0.05)


def test_pixels_are_averaged_by_weight():
    ahead = np.array([[0.05, 0.05, -1], [0.06, 0.05, -1]])
    mean, seen = directional_mean(ahead, np.array([[1.0, 2, 0], [4, 2, 0]]), np.array([2.0, 1.0]), NOT_CLIPPED[:2], 8)
    assert seen.sum() == 1
    np.testing.assert_allclose(mean[seen], [[2, 2, 0]])


@pytest.mark.parametrize(
    ("radiance", "clipped", "expected"),
    [((4, 2, 2), (0, 1, 1), 4), ((4, 7, 7), (0, 1, 1), 6), ((4, 4, 7), (1, 1, 1), 7), ((4, 4, 1), (0, 0, 0), 3)],
    ids=["bounds say nothing new", "bounds above", "bounds alone", "none"],
)
def test_clipped_pixels_of_a_direction_are_bounds(radiance, clipped, expected):
    ahead = np.tile([0.05, 0.05, -1.0], (3, 1))
    values = np.repeat(np.array(radiance, float)[:, None], 3, axis=1)
    mean, seen = directional_mean(ahead, values, np.ones(3), np.array(clipped, bool), 8)
    np.testing.assert_allclose(mean[seen], [[expected] * 3])


def test_fill_solves_laplace_on_the_sphere():
    """Between two bands of latitude the solution is linear in log(tan(theta / 2))."""
    rows, columns = 64, 8
    theta = (np.arange(rows) + 0.5) / rows * np.pi
    seen = np.zeros((rows, columns), bool)
    seen[:16] = seen[-16:] = True
    radiance = np.zeros((rows, columns, 3))
    radiance[:16], radiance[-16:] = 3, 1
    got = filled(radiance, seen)
    s = np.log(np.tan(theta / 2))
    inside = slice(15, 49)
    expected = 3 + (1 - 3) * (s[inside] - s[15]) / (s[48] - s[15])
    np.testing.assert_allclose(got[inside], np.broadcast_to(expected[:, None, None], (34, 8, 3)), rtol=2e-3)


def test_fill_beyond_a_single_texel_is_that_texel():
    seen = np.zeros((4, 8), bool)
    seen[2, 3] = True
    np.testing.assert_allclose(filled(seen[..., None] * np.array([1.0, 0.0, 5.0]), seen)[0, 0], [1, 0, 5], atol=1e-6)


def test_a_map_is_its_own_fit(np_rng):
    """Looking along every texel's centre gives the map back."""
    radiance = np_rng.random((8, 16, 3))
    mean, seen = directional_mean(texel_directions(8, 16), radiance.reshape(-1, 3), np.ones(128), NOT_CLIPPED, 8)
    assert seen.all()
    np.testing.assert_allclose(mean, radiance)
    assert EnvironmentMap("map", filled(mean, seen)).known
