"""The Mitsuba BSDF against the formulas, its own sampler, and the directional albedo."""

import numpy as np
import pytest

from fipt.model.albedo import specular_albedo
from fipt.render import bsdf

CASES = [
    # roughness, metallic, degrees from the normal
    (0.15, 0.0, 10.0),
    (0.25, 1.0, 60.0),
    (0.5, 0.5, 45.0),
    (1.0, 0.0, 30.0),
    (0.7, 1.0, 80.0),
]
COLOR = (0.8, 0.4, 0.2)


def material(roughness, metallic, color=COLOR):
    return {
        "type": bsdf.NAME,
        "base_color": {"type": "rgb", "value": list(color)},
        "roughness": roughness,
        "metallic": metallic,
    }


@pytest.fixture
def mi(backend):
    import mitsuba

    bsdf.register()
    return mitsuba


def vectors(mi, array):
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(c, np.float32)) for c in array.T))


def interaction(mi, to_camera):
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(to_camera))
    si.wi = vectors(mi, to_camera)
    return si


def hemisphere(rng, count):
    d = rng.standard_normal((count, 3))
    d[:, 2] = np.abs(d[:, 2]) + 0.05
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def expected(o, i, roughness, metallic, color=COLOR):
    """f(i, o) (n.i) in float64, with n = z."""
    color = np.asarray(color)
    kd, ks = color * (1 - metallic), 0.04 * (1 - metallic) + color * metallic
    h = (o + i) / np.linalg.norm(o + i, axis=1, keepdims=True)
    oh, nh = (o * h).sum(1), h[:, 2]
    alpha = roughness**2
    d = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    k = (roughness + 1) ** 2 / 8
    g = 1 / ((o[:, 2] * (1 - k) + k) * (i[:, 2] * (1 - k) + k))
    fc = (1 - oh) ** 5
    f = ks * (1 - fc)[:, None] + fc[:, None]
    return (kd / np.pi + f * (d * g / 4)[:, None]) * i[:, 2:]


def test_registering_twice_is_harmless(mi):
    bsdf.register()
    bsdf.register()
    assert mi.load_dict(material(0.5, 0.0)).component_count() == 2


@pytest.mark.parametrize(("roughness", "metallic", "angle"), CASES)
def test_value_is_the_formula(mi, np_rng, roughness, metallic, angle):
    o, i = hemisphere(np_rng, 4000), hemisphere(np_rng, 4000)
    plugin = mi.load_dict(material(roughness, metallic))
    value = plugin.eval(mi.BSDFContext(), interaction(mi, o), vectors(mi, i))
    np.testing.assert_allclose(np.array(value).T, expected(o, i, roughness, metallic), rtol=2e-4)


@pytest.mark.parametrize(("roughness", "metallic", "angle"), CASES)
def test_it_is_reciprocal_and_two_sided(mi, np_rng, roughness, metallic, angle):
    o, i = hemisphere(np_rng, 2000), hemisphere(np_rng, 2000)
    plugin, ctx = mi.load_dict(material(roughness, metallic)), mi.BSDFContext()

    def value(a, b):
        return np.array(plugin.eval(ctx, interaction(mi, a), vectors(mi, b))).T

    forth, back = value(o, i) / i[:, 2:], value(i, o) / o[:, 2:]
    np.testing.assert_allclose(forth, back, rtol=1e-4)
    np.testing.assert_array_equal(value(o, i), value(-o, -i))
    assert not value(o, -i).any()


@pytest.mark.parametrize(("roughness", "metallic", "angle"), CASES)
def test_samples_follow_the_density(mi, roughness, metallic, angle):
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    theta = np.radians(angle)
    sample, pdf = BSDFAdapter(
        bsdf.NAME,
        material(roughness, metallic),
        wi=[float(np.sin(theta)), 0.0, float(np.cos(theta))],
    )
    test = ChiSquareTest(
        domain=SphericalDomain(),
        sample_func=sample,
        pdf_func=pdf,
        sample_dim=3,
        sample_count=200_000,
        res=51,
        ires=16,
    )
    assert test.run(0.01, len(CASES), quiet=True), test.messages


@pytest.mark.parametrize(("roughness", "metallic", "angle"), CASES)
def test_weights_average_to_the_directional_albedo(mi, np_rng, roughness, metallic, angle):
    count, cos = 200_000, np.cos(np.radians(angle))
    o = np.tile([np.sqrt(1 - cos**2), 0.0, cos], (count, 1))
    u = [mi.Float(np_rng.random(count, np.float32)) for _ in range(3)]
    plugin = mi.load_dict(material(roughness, metallic))
    drawn, weight = plugin.sample(mi.BSDFContext(), interaction(mi, o), u[0], mi.Point2f(*u[1:]))
    weight = np.array(weight).T
    a0, a1 = specular_albedo(cos, roughness)
    color = np.array(COLOR)
    kd, ks = color * (1 - metallic), 0.04 * (1 - metallic) + color * metallic
    z = (weight.mean(0) - (kd + ks * a0 + a1)) / (weight.std(0) / np.sqrt(count))
    assert np.abs(z).max() < 4.5

    # The three parts of the interface agree with each other.
    value, density = plugin.eval_pdf(mi.BSDFContext(), interaction(mi, o), drawn.wo)
    np.testing.assert_array_equal(np.array(density), np.array(drawn.pdf))
    np.testing.assert_allclose(np.array(value).T, weight * np.array(density)[:, None], rtol=1e-4, atol=1e-6)


def test_furnace_shows_the_directional_albedo(mi):
    """A plate under a sky of radiance 1, through the path integrator, seen from both sides."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
            "plate": {"type": "rectangle", "bsdf": material(0.4, 0.0)},
        }
    )
    path = mi.load_dict({"type": "path", "max_depth": 4})
    count = 40_000
    a0, a1 = specular_albedo(0.5, 0.4)
    for side in (1.0, -1.0):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(7, count)
        direction = mi.Vector3f(-float(np.sqrt(0.75)), 0.0, -0.5 * side)
        ray = mi.RayDifferential3f(mi.Point3f(0, 0, 0) - direction, direction)
        seen = np.array(path.sample(scene, sampler, ray)[0]).T
        z = (seen.mean(0) - (np.array(COLOR) + 0.04 * a0 + a1)) / (seen.std(0) / np.sqrt(count))
        assert np.abs(z).max() < 4.5
