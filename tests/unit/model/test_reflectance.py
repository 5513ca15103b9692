"""Reflectance by hand: kd and ks, shading between its levels, radiance as a line in the base colour."""

import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.model.reflectance import (
    Brdf,
    brightest_reflection,
    exceeds_reflection,
    line_in_base_color,
    reflected,
    specular_shading,
)

LEVELS = len(ROUGHNESS_LEVELS)


@pytest.fixture
def rng():
    return torch.Generator().manual_seed(5)


def random(rng, *shape, dtype=torch.float32):
    return torch.rand(*shape, generator=rng, dtype=dtype)


def interpolated(shading, s):
    """Ls0 and Ls1 of one sample (outputs, 3) at roughnesses (Q,), by NumPy."""
    ends = np.split(shading[1:].numpy(), 2)
    return [np.stack([np.interp(s.numpy(), ROUGHNESS_LEVELS, each[:, c]) for c in range(3)], axis=-1) for each in ends]


def test_levels_are_met_exactly(rng):
    shading = random(rng, LEVELS, SHADING_OUTPUTS, 3)
    ls0, ls1 = specular_shading(shading, torch.tensor(ROUGHNESS_LEVELS)[:, None])
    number = torch.arange(LEVELS)
    np.testing.assert_allclose(ls0[:, 0], shading[number, 1 + number], rtol=1e-5)
    np.testing.assert_allclose(ls1[:, 0], shading[number, 1 + LEVELS + number], rtol=1e-5)


def test_between_levels_it_is_a_straight_line(rng):
    """However the levels are spaced: three roughnesses in every gap."""
    assert np.ptp(np.diff(ROUGHNESS_LEVELS)) > 0.05  # they are not even
    low, high = torch.tensor(ROUGHNESS_LEVELS)[:-1], torch.tensor(ROUGHNESS_LEVELS)[1:]
    s = low + torch.tensor([[0.1], [0.5], [0.85]]) * (high - low)
    shading = random(rng, 3, SHADING_OUTPUTS, 3)
    ls0, ls1 = specular_shading(shading, s)
    for sample in range(3):
        expected = interpolated(shading[sample], s[sample])
        np.testing.assert_allclose(ls0[sample], expected[0], rtol=1e-4)
        np.testing.assert_allclose(ls1[sample], expected[1], rtol=1e-4)


def test_reflected_radiance_by_hand(rng):
    shading = random(rng, 2, SHADING_OUTPUTS, 3)
    base = random(rng, 4, 3)
    roughness, metallic = torch.tensor([0.02, 0.216, 1.0, 0.314]), torch.tensor([0.0, 1.0, 0.25, 0.5])
    radiance, specular = reflected(Brdf(base, roughness, metallic), shading, 2)
    for sample in range(2):
        each, gloss = [], []
        for q in (2 * sample, 2 * sample + 1):
            m = metallic[q]
            kd, ks = base[q] * (1 - m), 0.04 * (1 - m) + base[q] * m
            ls0, ls1 = (torch.from_numpy(x[0]) for x in interpolated(shading[sample], roughness[q : q + 1]))
            gloss.append((ks * ls0 + ls1).mean())
            each.append(kd * shading[sample, 0] + ks * ls0 + ls1)
        np.testing.assert_allclose(radiance[sample], (each[0] + each[1]) / 2, rtol=1e-4)
        np.testing.assert_allclose(specular[sample], (gloss[0] + gloss[1]) / 2, rtol=1e-4)


def test_gradients_of_reflected_radiance(rng):
    """Against finite differences in float64, away from the levels where the line bends."""
    shading = random(rng, 3, SHADING_OUTPUTS, 3, dtype=torch.float64)
    base = random(rng, 6, 3, dtype=torch.float64).requires_grad_()
    roughness = torch.tensor([0.1, 0.3, 0.5, 0.7, 0.9, 0.25], dtype=torch.float64, requires_grad=True)
    metallic = random(rng, 6, dtype=torch.float64).requires_grad_()

    def f(base, roughness, metallic):
        return reflected(Brdf(base, roughness, metallic), shading, 2)

    assert torch.autograd.gradcheck(f, (base, roughness, metallic), eps=1e-6, atol=1e-7)


# --- radiance as a line in the base colour --------------------------------------------------------


def test_radiance_is_linear_in_base_colour_between_uneven_levels(np_rng):
    """One roughness for all pixels, or one for each; NumPy interpolates."""
    shading = np_rng.random((40, SHADING_OUTPUTS, 3)).astype(np.float32)
    s, m = np_rng.uniform(0.02, 1, 40), np_rng.uniform(0, 1, 40)
    s[: LEVELS + 2] = [*ROUGHNESS_LEVELS, 0.06, 0.17]  # the levels themselves, and both sides of the added one
    alpha, beta = line_in_base_color(shading, s, m)
    for k in range(40):
        ls0, ls1 = (
            [np.interp(s[k], ROUGHNESS_LEVELS, shading[k, first : first + LEVELS, c]) for c in range(3)]
            for first in (1, 1 + LEVELS)
        )
        expected = 0.04 * (1 - m[k]) * np.array(ls0) + ls1, (1 - m[k]) * shading[k, 0] + m[k] * np.array(ls0)
        alone = line_in_base_color(shading, float(s[k]), float(m[k]))
        for got, other, truth in zip((alpha, beta), alone, expected, strict=True):
            np.testing.assert_allclose(got[k], truth, rtol=1e-5)
            np.testing.assert_allclose(other[k], truth, rtol=1e-5)


# --- the brightest reflection ---------------------------------------------------------------------


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_what_exceeds_every_reflection_emits(library):
    shading = np.zeros((3, SHADING_OUTPUTS, 3), np.float32)
    shading[0, 0] = 1.0  # a white wall
    shading[1, [3, 3 + LEVELS]] = 0.5  # a mirror: Ls0 and Ls1 of one level add up
    shading[2] = 0.2
    radiance = np.float32([[1.4] * 3, [1.6] * 3, [1.6] * 3])
    if library == "torch":
        shading, radiance = torch.from_numpy(shading), torch.from_numpy(radiance)
    np.testing.assert_allclose(brightest_reflection(shading), [1.0001, 1.0001, 0.4001], rtol=1e-6)
    assert exceeds_reflection(radiance, shading, 1.5).tolist() == [False, True, True]
