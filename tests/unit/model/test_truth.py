"""True means of parts and the true emitters."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.model.parts import PartLabels
from fipt.model.truth import mean_materials, true_emitters, true_materials, true_pixels
from tests import scenes


def truth():
    """2 x 3 pixels: two of part 1, three of part 2, of which one emits; the last misses the mesh."""
    shape = (2, 3)
    emission = np.zeros((*shape, 3), np.float32)
    emission[1, 1] = (4, 2, 1)
    base = np.linspace(0.1, 0.6, 18, dtype=np.float32).reshape(*shape, 3)
    return {
        "base_color": base,
        "roughness": np.float32([[0.2, 0.4, 0.6], [0.8, 1, 0]]),
        "metallic": np.float32([[0, 1, 0], [0, 0, 0]]),
        "emission": emission,
    }


def pixels(layers):
    samples = scenes.samples_of(np.zeros((5, 3)), [0, 0, 1, 1, 2], counts=[1, 1, 1, 1, 1, 0], shapes=[(2, 3)])
    return true_pixels(SimpleNamespace(truth=lambda view: layers), [samples])


def test_a_part_has_its_mean_material():
    labels = PartLabels(np.int32([1, 2, 2]), np.zeros((1, 3), np.float32), np.int32([1]))
    brdf = mean_materials(labels, pixels(truth())).brdf
    base = truth()["base_color"].reshape(-1, 3)
    np.testing.assert_allclose(brdf.base_color[1], base[:2].mean(0), rtol=1e-6)
    np.testing.assert_allclose(brdf.base_color[2], base[2:4].mean(0), rtol=1e-6)
    np.testing.assert_allclose(brdf.roughness[1:], [0.3, 0.7], rtol=1e-6)
    np.testing.assert_allclose(brdf.metallic[1:], [0.5, 0], rtol=1e-6)


def test_what_emits_has_its_true_radiance():
    emitters = true_emitters(scenes.box((0, 0, 0), (1, 1, 1)), pixels(truth()))
    assert emitters.triangle.tolist() == [2]
    np.testing.assert_allclose(emitters.radiance, [[4, 2, 1]])


def test_of_a_lamp_what_no_pixel_shows_emits_as_well():
    """Two boxes: of the first something is dark; of the second one triangle is shown, and it emits."""
    mesh = scenes.joined(scenes.box((0, 0, 0), (1, 1, 1)), scenes.box((2, 0, 0), (3, 1, 1)))
    emission = np.float32([[4, 2, 1], [0, 0, 0], [8, 4, 2]])
    emitters = true_emitters(mesh, {"triangle": np.array([1, 2, 14]), "emission": emission})
    assert emitters.triangle.tolist() == [1, *range(12, 24)]
    np.testing.assert_allclose(emitters.radiance, [[4, 2, 1]] + 12 * [[8, 4, 2]])
    nothing = true_emitters(mesh, {"triangle": np.array([1, 2, 14]), "emission": 0 * emission})
    assert len(nothing.triangle) == 0


def test_a_missing_layer_is_named():
    layers = truth()
    del layers["base_color"]
    with pytest.raises(FiptError, match="it lacks base_color; compare without"):
        pixels(layers)


def test_a_place_has_the_material_of_the_nearest_pixel_that_does_not_emit():
    samples = scenes.samples_of(
        np.arange(15.0).reshape(5, 3), [0, 0, 1, 1, 2], counts=[1, 1, 1, 1, 1, 0], shapes=[(2, 3)]
    )
    found = true_pixels(SimpleNamespace(truth=lambda view: truth()), [samples])
    model = true_materials(scenes.box((0, 0, 0), (1, 1, 1)), found)
    brdf = model.query(samples.position + np.float32(0.1), triangle=np.arange(5))
    base = truth()["base_color"].reshape(-1, 3)
    np.testing.assert_allclose(brdf.base_color, base[[0, 1, 2, 3, 3]])
    assert brdf.roughness[0] == pytest.approx(0.2)
