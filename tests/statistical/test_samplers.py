"""Chi-square of every sampler of the tracer against its density."""

import itertools

import numpy as np
import pytest
from scipy import stats

from tests.scenes import Mesh

SIGNIFICANCE = 0.01
"""Chance that one test fails though its sampler is right; seeds are fixed, so it fails always or never."""
COUNT = 400_000


@pytest.fixture
def ggx(backend):
    from fipt.render import ggx

    return ggx


def uniform(rng, count=COUNT):
    import mitsuba as mi

    return [mi.Float(rng.random(count, np.float32)) for _ in range(3)]


def p_value(observed, expected):
    """Chance of a worse fit; cells of few expected counts are joined."""
    order = np.argsort(expected)
    observed, expected = observed[order], expected[order]
    few = np.searchsorted(np.cumsum(expected), 10) + 1
    observed = np.append(observed[few:], observed[:few].sum())
    expected = np.append(expected[few:], expected[:few].sum())
    return stats.chi2.sf(((observed - expected) ** 2 / expected).sum(), len(expected) - 1)


def basis(axis):
    """(3, 3) rotation whose last row is ``axis``."""
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.5 else np.array([0, 1.0, 0])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(axis, u), axis])


def cells_of(directions, axis, edges, sectors=8):
    """Counts in cells of the angle to ``axis`` (by ``edges`` of 2 sin(angle / 2), exact when small) and around it."""
    local = directions.astype(np.float64) @ basis(axis).T
    chord = np.linalg.norm(directions - axis, axis=1)
    around = np.arctan2(local[:, 1], local[:, 0])
    return np.histogram2d(chord, around, bins=[edges, np.linspace(-np.pi, np.pi, sectors + 1)])[0]


def integrals(density, axis, edges, sectors=8, nodes=24):
    """Integral of ``density`` ((N, 3) directions -> (N,)) over the cells of `cells_of`."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    result = np.zeros((len(edges) - 1, sectors))
    around = np.linspace(-np.pi, np.pi, sectors + 1)
    for i, (a, b) in enumerate(itertools.pairwise(edges)):
        for j, (c, d) in enumerate(itertools.pairwise(around)):
            r, phi = np.meshgrid((a + b + x * (b - a)) / 2, (c + d + x * (d - c)) / 2, indexing="ij")
            cos = 1 - r**2 / 2
            sin = r * np.sqrt(np.maximum(1 - r**2 / 4, 0))
            local = np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1).reshape(-1, 3)
            # in this angle's measure the sphere's area is r dr dphi
            values = density(local @ basis(axis)).reshape(r.shape) * r
            result[i, j] = np.einsum("i,j,ij->", w, w, values) * (b - a) * (d - c) / 4
    return result


def tangents(alpha, count=20):
    """Tangents of the angle between half vector and normal at evenly spaced quantiles of their distribution."""
    return alpha * np.sqrt(1 / (1 - np.linspace(0, 0.97, count)) - 1)


def test_cosine_samples_follow_their_density(ggx, np_rng):
    u1, u2, _ = uniform(np_rng)
    drawn = np.array(ggx.sample_cosine(u1, u2)).T
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1, atol=1e-5)
    up = np.array([0.0, 0, 1])
    edges = np.linspace(0, np.sqrt(2), 21)
    expected = integrals(lambda d: np.maximum(d[:, 2], 0) / np.pi, up, edges)
    assert expected.sum() == pytest.approx(1, abs=1e-6)
    observed = cells_of(drawn, up, edges)
    assert observed.sum() == COUNT
    assert p_value(observed.ravel(), COUNT * expected.ravel()) > SIGNIFICANCE


@pytest.mark.parametrize("roughness", [0.02, 0.1, 0.216, 0.5, 1.0])
def test_half_vectors_follow_their_density(ggx, np_rng, roughness):
    import mitsuba as mi

    alpha = roughness**2
    u1, u2, _ = uniform(np_rng)
    drawn = np.array(ggx.sample_half_vector(u1, u2, mi.Float(alpha))).T
    up = np.array([0.0, 0, 1])
    edges = np.append(2 * np.sin(np.arctan(tangents(alpha)) / 2), np.sqrt(2))

    def density(d):
        cos, sin2 = mi.Float(d[:, 2]), mi.Float(d[:, 0] ** 2 + d[:, 1] ** 2)
        return np.array(ggx.d_ggx(cos, sin2, mi.Float(alpha)), np.float64) * np.maximum(d[:, 2], 0)

    expected = integrals(density, up, edges)
    expected[-1] *= (1 - expected[:-1].sum()) / expected[-1].sum()  # a tail over decades: by what is left
    observed = cells_of(drawn, up, edges)
    assert p_value(observed.ravel(), COUNT * expected.ravel()) > SIGNIFICANCE


@pytest.mark.parametrize("degrees", [10.0, 65.0])
@pytest.mark.parametrize("roughness", [0.02, 0.216, 0.5, 1.0])
def test_reflected_directions_follow_their_density(ggx, np_rng, roughness, degrees):
    """The density holds where the half vector faces the viewer; the rest of the samples point below the surface."""
    import drjit as dr
    import mitsuba as mi

    alpha = roughness**2
    u1, u2, _ = uniform(np_rng)
    wo = np.array([np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))])
    o, n = mi.Vector3f(*map(float, wo)), mi.Vector3f(0, 0, 1)
    h = ggx.sample_half_vector(u1, u2, mi.Float(alpha))
    drawn = np.array(dr.normalize(2 * dr.dot(o, h) * h - o)).T
    facing = np.array(dr.dot(o, h)) > 0
    assert (drawn[~facing][:, 2] <= 1e-6).all()

    def density(d):
        geometry = ggx.ReflectionGeometry(n, mi.Vector3f(*(mi.Float(c) for c in d.T)), o)
        return np.array(geometry.pdf_ggx(mi.Float(alpha)), np.float64)

    mirror = np.array([-wo[0], 0, wo[2]])
    # at normal incidence a half vector at angle t reflects at 2 t: chord 2 sin t
    edges = 2 * np.sin(np.arctan(tangents(alpha)))
    expected = COUNT * integrals(density, mirror, edges)
    observed = cells_of(drawn[facing], mirror, edges)
    rest = COUNT - expected.sum()
    observed, expected = np.append(observed, COUNT - observed.sum()), np.append(expected, rest)
    assert p_value(observed, expected) > SIGNIFICANCE


@pytest.mark.parametrize("roughness", [0.02, 0.5, 1.0])
def test_reflected_directions_above_the_surface_are_all_in_the_density(ggx, np_rng, roughness):
    """The density integrates to one at normal incidence but for what reflects below the surface."""
    import drjit as dr
    import mitsuba as mi

    alpha = roughness**2
    u1, u2, _ = uniform(np_rng)
    o, n = mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1)
    h = ggx.sample_half_vector(u1, u2, mi.Float(alpha))
    above = (np.array(2 * dr.square(h.z) - 1) > 0).mean()

    def density(d):
        geometry = ggx.ReflectionGeometry(n, mi.Vector3f(*(mi.Float(c) for c in d.T)), o)
        return np.array(geometry.pdf_ggx(mi.Float(alpha)), np.float64)

    edges = np.concatenate([[0], np.geomspace(alpha / 50, np.sqrt(2), 60)])
    total = integrals(density, np.array([0.0, 0, 1]), edges, sectors=1).sum()
    assert total == pytest.approx(above, abs=4.5 * 0.5 / np.sqrt(COUNT) + 1e-4)


# --- emitters -------------------------------------------------------------------------------------


@pytest.fixture
def emitters(backend, np_rng):
    """300 small triangles, number k at x = k, with areas and radiances over several decades."""
    from fipt.render.surface import EmitterSet, Triangles

    count = 300
    size = np_rng.uniform(0.05, 0.4, count)
    corner = np.stack([np.arange(count) + 0.2, np.zeros(count), np.zeros(count)], axis=1)
    vertices = np.stack([corner, corner + size[:, None] * [1, 0, 0], corner + size[:, None] * [0, 0, 1]], axis=1)
    mesh = Mesh(vertices.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))
    radiance = (10 ** np_rng.uniform(-3, 2, (count, 3))).astype(np.float32)
    radiance[::7] = 0  # switched off
    order = np_rng.permutation(count).astype(np.int32)
    return mesh, radiance, Triangles(mesh, EmitterSet(order, radiance[order]))


def test_emitters_are_chosen_by_power(emitters, np_rng):
    import mitsuba as mi

    mesh, radiance, triangles = emitters
    power = mesh.areas * radiance.mean(axis=1)
    drawn = triangles.sample(*uniform(np_rng, 2_000_000), mi.Bool(True))
    x, z = np.array(drawn.p.x, np.float64), np.array(drawn.p.z, np.float64)
    chosen = np.floor(x).astype(int)
    observed = np.bincount(chosen, minlength=len(power))
    assert not observed[power == 0].any()
    on = power > 0
    assert p_value(observed[on], observed.sum() * (power / power.sum())[on]) > SIGNIFICANCE

    # position, normal, radiance and density are those of the chosen one
    np.testing.assert_array_equal(np.array(drawn.radiance).T, radiance[chosen])
    np.testing.assert_allclose(np.array(drawn.p_area), (power / power.sum() / mesh.areas)[chosen], rtol=1e-4)
    np.testing.assert_array_equal(np.array(drawn.n).T, mesh.normals[chosen])

    # uniform on the triangle: its four congruent quarters are as likely
    size = mesh.corners[chosen, 1, 0] - mesh.corners[chosen, 0, 0]
    a, b = (x - chosen - 0.2) / size, z / size
    quarter = np.where(a > 0.5, 1, np.where(b > 0.5, 2, np.where(a + b < 0.5, 0, 3)))
    assert p_value(np.bincount(quarter), np.full(4, len(a) / 4)) > SIGNIFICANCE


@pytest.mark.parametrize("count", [1, 2, 17, 1000])
def test_alias_table_holds_the_chances(backend, np_rng, count):
    from fipt.render.surface import alias_table

    chance = 10 ** np_rng.uniform(-6, 0, count)
    chance /= chance.sum()
    threshold, alias = alias_table(chance)
    stored = threshold.copy()
    np.add.at(stored, alias, 1 - threshold)
    np.testing.assert_allclose(stored / count, chance, rtol=1e-9, atol=1e-15)
    assert threshold.min() >= 0
    assert threshold.max() <= 1 + 1e-9


def test_opposite_directions_give_no_nan(backend):
    """wi = -wo has no half vector; whatever comes of it must be finite, since it is weighted by zero later."""
    import drjit as dr
    import mitsuba as mi

    from fipt.render import ggx

    # exactly opposite, and nearly so, with a half vector that points into the surface
    below = mi.Vector3f([1, 1], [0, 0], [0, -3e-5])
    g = ggx.ReflectionGeometry(mi.Vector3f(0, 0, 1), dr.normalize(below), mi.Vector3f(-1, 0, 0))
    values = [g.pdf_ggx(mi.Float(0.0004)), g.specular(mi.Float(0.02)), ggx.schlick(g.oh), g.pdf_cosine()]
    assert all(np.isfinite(np.array(value)).all() for value in values)
