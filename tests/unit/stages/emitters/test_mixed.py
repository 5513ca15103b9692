"""Emitters behind slats: every pixel shows both, by planted shares."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.stages.emitters.extract import extract
from fipt.stages.emitters.mixed import mixed_emitters
from fipt.stages.emitters.settings import EmittersSettings
from tests import scenes

SIDE, VIEWS = 32, 4
SLAT = 0.5


@pytest.fixture
def mesh():
    """A window that faces along z, and a slat that faces up: two triangles each."""
    return scenes.joined(scenes.quad((0, 0, 0), (0, 2, 0), (2, 0, 0)), scenes.quad((0, 1, 1), (2, 0, 0), (0, 0, 1)))


def shards(rng, window):
    """Four views of window and slat; a white surface would show 1 everywhere."""
    pixels = VIEWS * SIDE * SIDE
    share = rng.integers(3, 13, pixels) / 16
    samples = scenes.samples_of(
        np.zeros((2 * pixels, 3)),
        np.stack([rng.integers(0, 2, pixels), rng.integers(2, 4, pixels)], axis=1).reshape(-1),
        np.stack([share, 1 - share], axis=1).reshape(-1),
        np.full(pixels, 2),
        views=[f"v{k}" for k in range(VIEWS)],
        shapes=[(SIDE, SIDE)] * VIEWS,
        normal=np.tile(np.float32([[0, 0, 1], [0, 1, 0]]), (pixels, 1)),
    )
    image = share * window + (1 - share) * SLAT
    image = (image * np.exp(0.02 * rng.standard_normal(pixels)))[:, None] * np.ones(3)
    shading = np.zeros((2 * pixels, SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = 1
    return scenes.observed([samples], [shading], [(image.astype(np.float32), np.ones(pixels, np.float32))])


def test_a_window_behind_slats_emits(mesh, np_rng):
    seen = shards(np_rng, 6.0)
    found = mixed_emitters(mesh, seen)
    assert set(found.triangle) == {0, 1}
    np.testing.assert_allclose(found.radiance, 6.0, rtol=0.1)
    assert (np.diff(found.view) >= 0).all()
    np.testing.assert_array_equal(np.asarray(seen[0].samples.triangle)[found.sample], found.triangle)


def test_a_picture_behind_slats_does_not(mesh, np_rng):
    assert len(mixed_emitters(mesh, shards(np_rng, 0.9)).triangle) == 0


def test_the_whole_window_is_an_emitter(mesh, np_rng):
    found = extract(mesh, shards(np_rng, 6.0), None, EmittersSettings(guess=False)).emitters
    np.testing.assert_array_equal(found.triangle, [0, 1])
    np.testing.assert_allclose(found.radiance, 6.0, rtol=0.1)
    assert found.area.sum() == pytest.approx(4.0)
