"""Surface that hardly a pixel shows alone: a window behind slats, by planted shares."""

import numpy as np
import pytest

from fipt.scene import mixed
from fipt.scene.mixed import Islands, find_islands, unmixed
from tests import scenes

ROWS, COLUMNS = 32, 48
WINDOW, SLAT, WALL = (6.0, 6.5, 7.0), (1.0, 0.9, 0.8), (0.4, 0.4, 0.4)


@pytest.fixture
def mesh():
    """A window and a wall that face along z, a slat that faces up: two triangles each, no two connected."""
    window, wall = (scenes.quad((x, 0, 0), (0, 2, 0), (2, 0, 0)) for x in (0, 4))
    return scenes.joined(window, scenes.quad((0, 1, 1), (2, 0, 0), (0, 0, 1)), wall)


@pytest.fixture
def blinds(np_rng):
    """A view: the left two thirds show window and slat in every pixel, the rest the wall alone; shares of 16 rays."""
    pixels = ROWS * COLUMNS
    column = np.arange(pixels) % COLUMNS
    before = column < 32
    share = np_rng.uniform(0.1, 0.8, pixels)
    counted = np.clip(np.round(16 * share + 0.5 * np_rng.standard_normal(pixels)), 1, 15) / 16
    image = np.where(before[:, None], share[:, None] * WINDOW + (1 - share[:, None]) * SLAT, WALL)
    counts = np.where(before, 2, 1)
    first = np.cumsum(counts) - counts
    triangle, weight = np.full(counts.sum(), 4), np.ones(counts.sum())
    normal = np.tile(np.float32([0, 0, 1]), (len(triangle), 1))
    left, right = first[before], first[before] + 1
    triangle[left], triangle[right] = np_rng.integers(0, 2, len(left)), np_rng.integers(2, 4, len(left))
    weight[left], weight[right] = counted[before], 1 - counted[before]
    normal[right] = 0, 1, 0
    samples = scenes.samples_of(
        np.zeros((len(triangle), 3)), triangle, weight, counts, shapes=[(ROWS, COLUMNS)], normal=normal
    )
    return samples, image.astype(np.float32)


def test_islands_are_what_no_pixel_shows_alone(mesh, blinds):
    island = find_islands(mesh, [blinds[0]]).number
    assert island[0] == island[1] >= 0
    assert island[2] == island[3] >= 0
    assert island[0] != island[2]
    assert (island[4:] == -1).all()


def test_each_kind_is_told_by_its_shares(mesh, blinds):
    samples, image = blinds
    found = unmixed(samples, 0, find_islands(mesh, [samples]), image, np.ones(len(image), bool))
    triangle = np.asarray(samples.triangle)[found.sample]
    assert set(triangle) == {0, 1, 2, 3}
    np.testing.assert_allclose(np.median(found.radiance[triangle < 2], axis=0), WINDOW, rtol=0.05)
    np.testing.assert_allclose(np.median(found.radiance[triangle > 1], axis=0), SLAT, rtol=0.2)
    off = np.abs(found.radiance[triangle < 2] - WINDOW).mean(axis=1)
    assert np.median(off) < 3 * np.median(found.error[triangle < 2])


def test_pixels_that_are_not_usable_tell_nothing(mesh, blinds):
    samples, image = blinds
    island = find_islands(mesh, [samples])
    half = np.arange(len(image)) < len(image) // 2
    broken = np.where(half[:, None], image, 100)
    found = unmixed(samples, 0, island, broken, half)
    assert found.radiance.max() < 8
    assert len(unmixed(samples, 0, island, image, np.zeros(len(image), bool)).sample) == 0


def test_a_view_without_islands_tells_nothing(mesh, blinds):
    samples, image = blinds
    found = unmixed(samples, 0, Islands(np.full(6, -1), np.zeros(6, int)), image, np.ones(len(image), bool))
    assert found.radiance.shape == (0, 3)


def test_a_tile_that_has_no_solution_tells_nothing(mesh, blinds, monkeypatch):
    def endless(*_):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(mixed, "nnls", endless)
    samples, image = blinds
    found = unmixed(samples, 0, find_islands(mesh, [samples]), image, np.ones(len(image), bool))
    assert len(found.sample) == 0
