"""What a refinement changed, told apart from noise, and what is kept of the round before."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.shading import Shading
from fipt.stages.shade.change import keep_share, light_is_missing, measure_change
from tests import scenes

VIEWS, ROW = 8, 4000


@pytest.fixture
def samples(np_rng):
    """A floor of 4 m x 4 m, all of it seen by eight views."""
    position = np_rng.random((VIEWS * ROW, 3)) * (4, 0, 4)
    names = [f"v{k}" for k in range(VIEWS)]
    return scenes.samples_of(position, views=names, shapes=[(40, 100)] * VIEWS)


def estimates(np_rng, learnt, noise):
    """Two estimates of a shading of 1: they differ by ``learnt`` everywhere, and each has noise."""
    size = VIEWS * ROW
    old = np.exp(noise * np_rng.standard_normal(size))
    return np.exp(learnt + noise * np_rng.standard_normal(size)), old


@pytest.mark.parametrize(("learnt", "noise"), [(0.15, 0.05), (0.05, 0.05), (-0.04, 0.1), (0.02, 0.0)])
def test_change_and_noise_are_told_apart(samples, np_rng, learnt, noise):
    found = measure_change(samples, *estimates(np_rng, learnt, noise), 0.5)
    assert found.change == pytest.approx(abs(learnt), abs=0.004)
    assert found.noise == pytest.approx(noise, abs=0.003)
    assert found.kept == pytest.approx(noise**2 / (learnt**2 + 2 * noise**2), abs=0.02)
    assert found.samples == VIEWS * ROW


def test_noise_alone_keeps_half(samples, np_rng):
    found = measure_change(samples, *estimates(np_rng, 0.0, 0.1), 0.5)
    assert found.change < 0.01
    assert found.kept == pytest.approx(0.5, abs=0.01)


def test_change_that_differs_from_place_to_place(samples, np_rng):
    """It counts as learnt where views agree about it, even if its mean over the room is zero."""
    wave = 0.2 * np.sign(np.asarray(samples.position)[:, 0] - 2)
    found = measure_change(samples, np.exp(wave), np.ones(VIEWS * ROW), 0.5)
    assert found.change == pytest.approx(0.2, abs=0.01)
    assert found.kept < 0.03


@pytest.mark.parametrize(("new", "old"), [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)])
def test_black_shading(samples, new, old):
    size = VIEWS * ROW
    found = measure_change(samples, np.full(size, new), np.full(size, old), 0.5)
    assert np.isfinite([found.change, found.noise, found.kept]).all()


def test_one_view_tells_nothing_apart(np_rng):
    alone = scenes.samples_of(np_rng.random((100, 3)))
    found = measure_change(alone, np.full(100, 2.0), np.ones(100), 0.5)
    assert (found.change, found.kept) == (0.0, 0.5)


def test_the_mean_is_written(samples):
    """What all views find twice as bright is kept to no share; what is alike stays alike."""
    size = VIEWS * ROW
    old = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 1.0, np.float32))
    new = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 2.0, np.float32))
    found = keep_share(samples, new, old, 0.5)
    assert found.kept < 0.01
    np.testing.assert_allclose(new[:][:, 0], 2.0, rtol=0.03)
    same = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 1.0, np.float32))
    assert keep_share(samples, same, old, 0.5).change < 0.005
    np.testing.assert_allclose(same[:][:, 0], 1.0, rtol=0.03)


@pytest.mark.parametrize(("light", "expected"), [(0.2, True), (0.7, False), (1.3, False)])
def test_missing_light_is_told_by_surface_brighter_than_white(samples, light, expected):
    """A grey room of albedo 0.5 under a light of 1, of which a round finds a share."""
    size = VIEWS * ROW
    photo = np.full((ROW, 3), 0.5, np.float32)
    views = [(photo, np.ones(ROW), np.zeros(ROW, bool))] * VIEWS
    old = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 1.0, np.float32))
    new = Shading.of(np.full((size, SHADING_OUTPUTS, 3), light, np.float32))
    assert light_is_missing(samples, new, old, views, np.array([5])) == expected
    assert not light_is_missing(samples, new, new, views, np.array([5]))
    assert not light_is_missing(samples, new, old, views, np.array([0]))  # all that is seen emits


def test_all_of_the_round_before_stays(samples):
    size = VIEWS * ROW
    old = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 1.0, np.float32))
    new = Shading.of(np.full((size, SHADING_OUTPUTS, 3), 0.2, np.float32))
    found = keep_share(samples, new, old, 0.5, whole=True)
    assert (found.kept, found.light_missing) == (1, 1)
    assert found.change == pytest.approx(1.0, abs=0.1)  # differences count up to there
    np.testing.assert_allclose(new[:][:, 0], 1.0, rtol=0.03)
