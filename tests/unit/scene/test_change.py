"""What a refinement changed, told apart from noise, and what is kept of the round before."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.scene.change import (
    DIFFERENCES,
    ShadingDifferences,
    measured_change,
    read_change,
    read_round,
    view_differences,
    write_differences,
)
from fipt.scene.shading import BEFORE, Shading, save_shading
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


def differences(samples, new, old, brighter=(0.0, 0)):
    """Differences of all views."""
    views = []
    for index in range(len(samples.views)):
        own = samples.of_view(index)
        box = (np.float64([2, 0, 2]), 4.2)
        views.append(view_differences(samples, index, (new[own], old[own]), box, brighter))
    return ShadingDifferences.joined(views)


@pytest.mark.parametrize(("learnt", "noise"), [(0.15, 0.05), (0.05, 0.05), (-0.04, 0.1), (0.02, 0.0)])
def test_change_and_noise_are_told_apart(samples, np_rng, learnt, noise):
    found = measured_change(differences(samples, *estimates(np_rng, learnt, noise)), 0.5)
    assert found.change == pytest.approx(abs(learnt), abs=0.004)
    assert found.noise == pytest.approx(noise, abs=0.003)
    assert found.kept == pytest.approx(noise**2 / (learnt**2 + 2 * noise**2), abs=0.02)


def test_noise_alone_keeps_half(samples, np_rng):
    found = measured_change(differences(samples, *estimates(np_rng, 0.0, 0.1)), 0.5)
    assert found.change < 0.01
    assert found.kept == pytest.approx(0.5, abs=0.01)


def test_change_that_differs_from_place_to_place(samples, np_rng):
    """It counts as learnt where views agree about it, even if its mean over the room is zero."""
    wave = 0.2 * np.sign(np.asarray(samples.position)[:, 0] - 2)
    found = measured_change(differences(samples, np.exp(wave), np.ones(VIEWS * ROW)), 0.5)
    assert found.change == pytest.approx(0.2, abs=0.01)
    assert found.kept < 0.03


@pytest.mark.parametrize(("new", "old"), [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)])
def test_black_shading(samples, new, old):
    size = VIEWS * ROW
    found = measured_change(differences(samples, np.full(size, new), np.full(size, old)), 0.5)
    assert np.isfinite([found.change, found.noise, found.kept]).all()


def test_one_view_tells_nothing_apart(np_rng):
    alone = scenes.samples_of(np_rng.random((100, 3)))
    found = measured_change(differences(alone, np.full(100, 2.0), np.ones(100)), 0.5)
    assert (found.change, found.kept) == (0.0, 0.5)


@pytest.mark.parametrize(("more", "missing"), [(0.5, True), (0.05, False)])
def test_light_is_missing_where_all_views_have_become_brighter_than_white(samples, more, missing):
    new, old = np.full(VIEWS * ROW, 0.2), np.ones(VIEWS * ROW)
    found = measured_change(differences(samples, new, old, (more, 100)), 0.5)
    assert (found.kept == 1, found.light_missing) == (missing, missing)
    assert not measured_change(differences(samples, new, old, (0.0, 0)), 0.5).light_missing  # no view tells


def write_shard(folder, samples, new, old, damping=0.5):
    """A folder of refined shading, the same everywhere."""
    size = len(samples.position)
    folder.mkdir()
    for name, value in (("shading.npy", new), (BEFORE, old)):
        save_shading(folder, Shading.of(np.full((size, SHADING_OUTPUTS, 3), value, np.float32)), name)
    write_differences(folder, differences(samples, np.full(size, new), np.full(size, old)), damping)
    return folder


def test_a_round_is_read_with_what_is_kept_of_the_one_before(tmp_path, np_rng):
    """One view tells nothing apart: half is kept. Another shard has the same share."""
    alone = scenes.samples_of(np_rng.random((50, 3)))
    folders = [write_shard(tmp_path / "a", alone, 2.0, 1.0)]
    assert read_change(folders).kept == 0.5
    np.testing.assert_allclose(read_round(folders, [alone])[0][:][:, 0], 1.5, rtol=0.03)
    folders.append(write_shard(tmp_path / "b", alone, 2.0, 1.0))
    assert read_change(folders).kept == 0  # two views agree
    np.testing.assert_allclose(read_round(folders, [alone, alone])[1][:][:, 0], 2.0, rtol=0.03)
    assert read_change([]) is None


def test_a_view_without_surface(tmp_path):
    nothing = scenes.samples_of(np.zeros((0, 3)), counts=np.zeros(4, int))
    change = read_change([write_shard(tmp_path / "a", nothing, 1.0, 1.0)])
    assert (change.kept, change.light_missing) == (0.5, False)


def test_shards_of_two_rounds(tmp_path, np_rng):
    alone = scenes.samples_of(np_rng.random((50, 3)))
    refined, baked = write_shard(tmp_path / "a", alone, 2.0, 1.0), write_shard(tmp_path / "b", alone, 2.0, 1.0)
    (baked / DIFFERENCES).unlink()
    with pytest.raises(FiptError, match="is missing"):
        read_round([refined, baked], [alone, alone])
    assert read_change([baked]) is None
