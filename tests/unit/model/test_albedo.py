"""Directional albedo: against an integral over directions, its table, and figures that are known."""

import numpy as np
import pytest

from fipt.model.albedo import albedo_terms, reflectance, specular_albedo


def integral(cos, s, nodes=160):
    """A0 and A1 by Gauss quadrature over the hemisphere of directions to the light."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    z, phi = np.meshgrid((x + 1) / 2, np.pi * (x + 1) / 2, indexing="ij")  # symmetric in phi: half of it, twice
    i = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z])
    o = np.array([np.sqrt(1 - cos**2), 0, cos])[:, None, None]
    h = i + o
    h /= np.linalg.norm(h, axis=0)
    alpha2, k = s**4, (s + 1) ** 2 / 8
    d = alpha2 / (np.pi * (h[2] ** 2 * (alpha2 - 1) + 1) ** 2)
    g = 1 / ((z * (1 - k) + k) * (cos * (1 - k) + k))
    fc = (1 - (o * h).sum(axis=0)) ** 5
    weight = np.outer(w, w) * np.pi / 4 * 2 * d * g / 4 * z
    return ((1 - fc) * weight).sum(), (fc * weight).sum()


@pytest.mark.parametrize("cos", [0.1, 0.4, 0.8, 1.0])
@pytest.mark.parametrize("s", [0.35, 0.6, 1.0])
def test_it_is_the_integral_over_directions(cos, s):
    np.testing.assert_allclose(specular_albedo(cos, s), integral(cos, s), atol=1.5e-3)


def test_a_mirror_reflects_what_schlick_says():
    for cos in (0.3, 0.7, 1.0):
        fc, k = (1 - cos) ** 5, 1.02**2 / 8
        whole = cos / (cos * (1 - k) + k) ** 2 * cos  # G (n.i): the rest of the weight cancels
        a0, a1 = specular_albedo(cos, 0.02)
        assert a0 == pytest.approx((1 - fc) * whole, rel=5e-3)
        assert a1 == pytest.approx(fc * whole, rel=5e-3, abs=1e-4)


def test_the_table_is_close_everywhere(np_rng):
    cos, s = np_rng.uniform(0.02, 1, 120), np_rng.uniform(0.02, 1, 120)
    a0, a1 = albedo_terms(cos, s)
    exact = np.array([specular_albedo(c, r) for c, r in zip(cos, s, strict=True)])
    np.testing.assert_allclose(np.stack([a0, a1], axis=1), exact, atol=0.005)


def test_ends_and_shapes_of_the_table():
    a0, a1 = albedo_terms(np.array([[0.02, 1.0, 0.5]]), np.array([[0.02, 1.0, 1.0]]))
    assert a0.shape == a1.shape == (1, 3)
    assert a0.dtype == np.float32
    np.testing.assert_allclose(a0[0, 1], specular_albedo(1.0, 1.0)[0], atol=5e-3)
    beyond, _ = albedo_terms(np.array([0.0, 1.0]), np.array([0.0, 1.2]))  # outside: as at the border
    np.testing.assert_allclose(beyond, [albedo_terms(0.02, 0.02)[0], albedo_terms(1.0, 1.0)[0]], rtol=1e-5)


def test_reflectance_by_its_terms(np_rng):
    base, s, m, cos = np_rng.random((5, 3)), np_rng.uniform(0.1, 1, 5), np_rng.random(5), np_rng.uniform(0.1, 1, 5)
    a0, a1 = albedo_terms(cos, s)
    expected = base * (1 - m[:, None]) + (0.04 * (1 - m) + base.T * m).T * a0[:, None] + a1[:, None]
    np.testing.assert_allclose(reflectance(base, s, m, cos), expected, rtol=1e-5)


def test_known_figures():
    """A white dielectric reflects a little more than it gets, a rough white metal a third of it."""
    white = np.ones((50, 3))
    cos = np.linspace(0.3, 1, 50)
    for s in (0.05, 0.5, 1.0):
        a = reflectance(white, np.full(50, s), np.zeros(50), cos)
        assert a.min() > 1.0
        assert a.max() < 1.2
    assert reflectance(white[:1], np.ones(1), np.ones(1), np.ones(1))[0, 0] == pytest.approx(0.31, abs=0.02)
