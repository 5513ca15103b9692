"""Material maps: what each layer holds, averages over a hit, emission by triangle."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.model.albedo import reflectance
from fipt.model.networks import Brdf
from fipt.scene.confidence import Confidence
from fipt.scene.emitters import BACK, FRONT, Emitters
from tests import scenes


@pytest.fixture
def maps(backend):
    from fipt.stages.render import maps

    return maps


class Waves:
    """A field whose materials follow x; it notes the sizes it was asked for."""

    def __init__(self, footprint=1.0):
        self.asked = []
        self.settings = SimpleNamespace(footprint=footprint)

    def place(self, points, normals):
        return points - 0.1 * normals

    def query(self, points, footprint, triangle=None):
        self.asked.append(np.asarray(footprint))
        x = points[:, 0]
        return Brdf(np.stack([x, x / 2, 0 * x], axis=1), 0.1 + 0.5 * x, x / 4)

    def finest_at(self, points):
        return np.zeros(len(points), np.float32)


ROOM = scenes.box((0, 0, 0), (1, 1, 1))


def emitter(*triangles):
    n = len(triangles)
    ones = np.ones(n, np.float32)
    radiance = np.float32([[t, 2 * t, 3 * t] for t in triangles]).reshape(-1, 3)
    return Emitters(
        np.array(triangles, np.int32), radiance, ones, np.zeros(n, np.int32), ones, ones, 0 * ones, ones > 1
    )


def view(position, counts, center=None, triangle=0):
    samples = scenes.samples_of(
        position, triangle, 1.0, counts, shapes=[(2, 2)], footprint=np.full(len(position), 0.04, np.float32)
    )
    if center is not None:
        samples.center[:] = center
    samples.sub[:, :, 0] = np.array([-0.2, 0.0, 0.1, 0.3])
    return samples


def test_materials_are_the_mean_over_a_hit(maps):
    samples, field = view(np.float32([[0.4, 0, 0], [0.6, 0, 0], [0.5, 0, 0]]), [1, 1, 1, 0]), Waves(footprint=0.5)
    brdf = maps.sample_materials(field, samples, np.array([2, 0]), average=True)
    np.testing.assert_allclose(brdf.base_color[:, 0], [0.55, 0.45], rtol=1e-3)
    np.testing.assert_allclose(brdf.roughness, [0.375, 0.325], rtol=1e-3)
    np.testing.assert_allclose(brdf.metallic, [0.1375, 0.1125], rtol=1e-3)
    np.testing.assert_allclose(field.asked[0], np.full(8, 0.02), rtol=1e-6)
    field.settings.footprint = 1.0
    point = maps.sample_materials(field, samples, np.array([2, 0]), average=False)
    np.testing.assert_allclose(point.base_color[:, 0], [0.5, 0.4], rtol=1e-6)
    np.testing.assert_allclose(field.asked[1], np.full(2, 0.04), rtol=1e-6)


@pytest.mark.parametrize("average", [True, False])
def test_a_field_is_asked_below_the_surface_that_the_viewer_sees(maps, average):
    samples = view(np.float32([[0.4, 0, 0], [0.6, 0, 0]]), [1, 1, 0, 0])
    samples.normal[:] = np.float32([[1, 0, 0], [-1, 0, 0]])
    brdf = maps.sample_materials(Waves(), samples, np.array([0, 1]), average)
    moved = 0.05 * average  # the mean of the stored points
    np.testing.assert_allclose(brdf.base_color[:, 0], [0.3 + moved, 0.7 + moved], rtol=1e-3)


def test_layers_of_a_view(maps):
    """Pixel 1 shows two pieces: its first is the centre's. Pixel 3 is covered, but not at its centre."""
    position = np.float32([[0.1, 0, 0], [0.2, 0, 0], [0.9, 0, 0], [0.4, 0, 0], [0.7, 0, 0]])
    samples = view(position, [1, 2, 1, 1], [1, 1, 1, 0], triangle=[0, 7, 0, 0, 7])
    camera = SimpleNamespace(center=np.array([0.5, 2.0, 0.3]))
    # a view saw only what lies at 0.25 <= x < 0.5 and faces up
    place = np.array([6 * (5 + 8 * (4 + 8 * 4)) + 3])
    errors = (np.full(1, error) for error in (0.1, 0.2, 0.3))
    confidence = Confidence(np.zeros(3), 2.0, 8, place, *errors, np.ones(1, bool), np.float32([0.25, 0.5, 0.75]))
    layers = maps.material_maps(
        maps.FittedSurface(Waves(), emitter(7), ROOM, confidence), samples, 0, camera, average=False
    )
    x = np.float32([[0.1, 0.2], [0.4, 0.0]])
    hit = np.array([[1, 1], [1, 0]])
    np.testing.assert_array_equal(layers["hit.Y"], hit)
    np.testing.assert_allclose(layers["base_color"][..., 0], x)
    np.testing.assert_allclose(layers["metallic.Y"], x / 4)
    np.testing.assert_allclose(layers["roughness.Y"], (0.1 + 0.5 * x) * hit, rtol=1e-6)
    np.testing.assert_allclose(layers["confidence.Y"], [[0, 0], [0.4, 0]], rtol=1e-6)  # 20 dB
    np.testing.assert_allclose(layers["kd_error.Y"], [[0.25, 0.25], [0.1, 0]], rtol=1e-6)
    np.testing.assert_allclose(layers["roughness_error.Y"], [[0.5, 0.5], [0.2, 0]], rtol=1e-6)
    np.testing.assert_allclose(layers["metallic_error.Y"], [[0.75, 0.75], [0.3, 0]], rtol=1e-6)
    np.testing.assert_allclose(layers["kd"][..., 0], x * (1 - x / 4), rtol=1e-6)
    np.testing.assert_array_equal(layers["emission"][..., 0], [[0, 7], [0, 0]])
    np.testing.assert_array_equal(layers["emission_mask.Y"], [[0, 1], [0, 0]])
    front = ROOM.front([7], np.float32([[0, 1, 0]]))[0]
    dark = replace(emitter(7), sides=np.int8([BACK if front else FRONT]))
    surface = maps.FittedSurface(Waves(), dark, ROOM, confidence)
    assert not maps.material_maps(surface, samples, 0, camera, average=False)["emission"].any()
    away = camera.center - position[[0, 1, 3]]
    cos = away[:, 1] / np.linalg.norm(away, axis=1)
    xs = position[[0, 1, 3], 0]
    base = np.stack([xs, xs / 2, 0 * xs], axis=1)
    expected = reflectance(base, 0.1 + 0.5 * xs, xs / 4, cos)
    np.testing.assert_allclose(layers["reflectance"].reshape(-1, 3)[:3], expected, rtol=1e-5)
    assert not layers["reflectance"][1, 1].any()
    assert {a.dtype for a in layers.values()} == {np.dtype(np.float32)}
