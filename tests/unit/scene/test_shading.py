"""Packed shading: how far what is read lies from what was written, and what must be exact."""

import numpy as np
import pytest

from fipt.conventions import LUMINANCE, ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.formats.arrays import save_npy
from fipt.scene.shading import Shading, read_shading, save_shading
from tests import scenes

LEVELS = len(ROUGHNESS_LEVELS)


def drawn(rng, count=40_000):
    """Shading over 20 octaves; Ls1 is anything from a millionth of its level to nearly all of it, of its colour."""
    color = rng.dirichlet([2, 2, 2], (count, 1 + LEVELS)) * 2.0 ** rng.uniform(-9, 11, (count, 1 + LEVELS, 1))
    share = rng.random((count, LEVELS, 1)) ** 6
    return np.concatenate([color[:, :1], color[:, 1:] * (1 - share), color[:, 1:] * share], axis=1, dtype=np.float32)


def reflected(values, kd, ks):
    """Luminance that a surface reflects, by level."""
    light = values @ np.array(LUMINANCE)
    return kd * light[:, :1] + ks * light[:, 1 : 1 + LEVELS] + light[:, 1 + LEVELS :]


def test_what_a_surface_reflects_is_within_one_per_cent_without_bias(np_rng):
    values = drawn(np_rng)
    packed = Shading.of(values)[:]
    assert packed.shape == values.shape
    assert packed.dtype == np.float32
    diffuse = packed[:, 0] @ np.array(LUMINANCE) / (values[:, 0] @ np.array(LUMINANCE)) - 1
    assert diffuse.std() < 0.003
    for kd, ks in ((0, 0.04), (0.5, 0.04), (0, 0.9)):
        error = reflected(packed, kd, ks) / reflected(values, kd, ks) - 1
        assert np.sqrt((error**2).mean()) < 0.009, (kd, ks)
        assert np.abs(error).max() < 0.035
        assert np.abs(error.mean(axis=0)).max() < 5 * error.std() / np.sqrt(len(values)), (kd, ks)


def test_colours_have_no_bias(np_rng):
    values = drawn(np_rng)
    packed = Shading.of(values)[:]
    for output in range(1 + LEVELS):
        seen = (values if output == 0 else values + np.roll(values, -LEVELS, axis=1))[:, output]
        read = (packed if output == 0 else packed + np.roll(packed, -LEVELS, axis=1))[:, output]
        error = (read - seen) / seen.mean(axis=1, keepdims=True)
        assert np.sqrt((error**2).mean()) < (0.01 if output == 0 else 0.02)
        assert np.abs(error.mean(axis=0)).max() < 5 * error.std() / np.sqrt(len(values)) + 1e-4


def test_light_that_is_the_same_everywhere_keeps_its_mean():
    """No single rounding error is repeated over a wall."""
    values = np.full((20_000, SHADING_OUTPUTS, 3), 0.3137, np.float32)
    values[:, 1 + LEVELS :] *= 0.173
    np.testing.assert_allclose(Shading.of(values)[:].mean(axis=0), values[0], rtol=2e-3)


def test_dark_stays_dark_and_black_channels_black(np_rng):
    values = drawn(np_rng, 500)
    values[:100] = 0
    values[100:200, 1 + LEVELS :] = 0
    values[200:300, :, 2] = 0
    values[300:400, :, 1:] = 0
    values[400:, 3] = values[400:, 3 + LEVELS] = 0
    packed = Shading.of(values)[:]
    np.testing.assert_array_equal(packed[:100], 0)
    np.testing.assert_array_equal(packed[100:200, 1 + LEVELS :], 0)
    np.testing.assert_array_equal(packed[200:300, :, 2], 0)
    np.testing.assert_array_equal(packed[300:400, :, 1:], 0)
    np.testing.assert_array_equal(packed[400:, [3, 3 + LEVELS]], 0)
    assert (packed[:, 0][values[:, 0].sum(axis=1) > 0].sum(axis=1) > 0).all()


@pytest.mark.parametrize("value", [1e-30, 2.0**-15.9, 2.0**15.9, 3e38])
def test_the_ends_of_the_range(value):
    packed = Shading.of(np.full((50, SHADING_OUTPUTS, 3), np.float32(value)))[:]
    assert np.isfinite(packed).all()
    expected = 0 if value < 2.0**-16 else min(value, 2**16)
    np.testing.assert_allclose(packed[:, 0], expected, rtol=0.02)


def test_samples_read_alone_are_those_of_the_whole(np_rng, tmp_path):
    shading = Shading.of(drawn(np_rng, 20_000))
    save_shading(tmp_path, shading)
    stored = read_shading(tmp_path)
    assert stored.shape == (20_000, SHADING_OUTPUTS, 3)
    whole = stored[:]
    chosen = np_rng.integers(0, 20_000, 300)
    np.testing.assert_array_equal(stored[chosen], whole[chosen])
    np.testing.assert_array_equal(stored[50:60], whole[50:60])
    assert stored[:0].shape == (0, SHADING_OUTPUTS, 3)


def test_a_view_is_packed_alike_wherever_it_stands(np_rng):
    values = drawn(np_rng, 300)
    both = Shading.empty(500)
    both[:200], both[200:] = values[:200], values
    np.testing.assert_array_equal(both.words[200:], Shading.of(values).words)


def test_a_pixel_takes_less_than_50_bytes():
    """With 1.33 hits a pixel, as a furnished room at 160x120 has; one more level fits as well."""
    assert 1.33 * Shading.empty(100).nbytes / 100 <= 50 - 1.33 * 4


def test_other_shading_is_refused(tmp_path):
    save_npy(tmp_path / "shading.npy", np.zeros((4, 13, 3), np.float16))
    with pytest.raises(FiptError, match="bake it again"):
        read_shading(tmp_path)
    save_shading(tmp_path, Shading.empty(4))
    with pytest.raises(FiptError, match=r"must hold shading of shape \(5, "):
        read_shading(tmp_path, scenes.samples_of(np.zeros((5, 3))))
