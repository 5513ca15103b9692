"""Albedo as radiance over irradiance, where it is known; emitters by a threshold."""

from dataclasses import replace

import numpy as np

from fipt.conventions import SHADING_OUTPUTS
from fipt.model.parts import PartLabels
from fipt.scene.emitters import Emitters
from fipt.stages.irradiance.estimate import albedo_of_parts, threshold_emitters
from tests import scenes

ALBEDO = np.float32([[0.2, 0.4, 0.6], [0.8, 0.5, 0.1]])


def test_a_picture_on_a_wall_of_another_part_has_a_material():
    """Part 9 has pixels, but no triangle: what is nearest to them is asked for like any other."""
    labels = PartLabels(np.full(12, 2, np.int32), np.float32([[0, 0, 0]]), np.int32([9]))
    model = albedo_of_parts(labels, shards(), Emitters.none())
    found = model.query(np.float32([[0.1, 0, 0]]))
    np.testing.assert_array_equal(found.base_color, model.brdf.base_color[[0]], "what no pixel tells has the median")


def shards():
    """A box whose first four triangles are part 1, the next part 2; triangles 10 and 11 shine, 11 in one pixel only."""
    rng = np.random.default_rng(0)
    triangle = np.repeat(np.arange(12), 5)
    diffuse = rng.uniform(0.5, 2, (60, 3)).astype(np.float32)
    radiance = ALBEDO[np.where(triangle < 4, 0, 1)] * diffuse
    radiance[triangle == 10] = (9, 7, 5)
    radiance[-1] = 50
    radiance[0] = 3  # an outlier
    shading = np.zeros((60, SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = diffuse
    samples = scenes.samples_of(rng.random((60, 3)), triangle)
    return scenes.observed([samples], [shading], [(radiance, np.ones(60, np.float32))])


def test_a_triangle_emits_where_most_of_its_pixels_are_bright():
    mesh = scenes.box((0, 0, 0), (1, 1, 1))
    emitters = threshold_emitters(mesh, shards(), 4.0)
    assert emitters.triangle.tolist() == [10]
    np.testing.assert_allclose(emitters.radiance, [[9, 7, 5]])
    np.testing.assert_allclose(emitters.area, mesh.areas[[10]])
    assert len(threshold_emitters(mesh, shards(), 100.0).triangle) == 0


def test_clipped_pixels_tell_emitters_and_no_albedo():
    (shard,) = shards()
    lamp = [replace(shard, clipped=np.repeat(np.arange(12), 5) == 10)]
    assert threshold_emitters(scenes.box((0, 0, 0), (1, 1, 1)), lamp, 4.0).triangle.tolist() == [10]
    labels = PartLabels(np.int32([1] + [2] * 11), np.zeros((1, 3), np.float32), np.int32([1]))
    radiance = np.array(shard.radiance)
    radiance[:3] = 9  # most pixels of part 1, unless clipped ones are left out
    clipped = [replace(shard, radiance=radiance, clipped=np.arange(60) < 3)]
    brdf = albedo_of_parts(labels, clipped, Emitters.none()).brdf
    np.testing.assert_allclose(brdf.base_color[1], ALBEDO[0], rtol=1e-6)


def test_albedo_is_the_median_over_the_pixels_of_a_part():
    labels = PartLabels(np.int32([1] * 4 + [2] * 8), np.zeros((1, 3), np.float32), np.int32([1]))
    emitters = Emitters.plain(scenes.box((0, 0, 0), (1, 1, 1)), np.array([10]), np.ones((1, 3)), np.array([0]))
    brdf = albedo_of_parts(labels, shards(), emitters).brdf
    np.testing.assert_allclose(brdf.base_color[1:], ALBEDO, rtol=1e-6)
    assert brdf.roughness.tolist() == [1, 1, 1]
    assert brdf.metallic.tolist() == [0, 0, 0]
