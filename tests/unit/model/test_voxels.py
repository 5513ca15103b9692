"""Materials of the cache's voxels."""

import numpy as np

from fipt.model.networks import Brdf
from fipt.model.voxels import voxel_materials
from tests import scenes


def test_unseen_voxels_take_the_material_of_the_one_that_stands_for_them():
    voxels = scenes.grid(resolution=2, side=3.0)
    voxels["source"] = np.array([0, 0, 2, 2, 4, 5, 6, 0], np.int32)
    asked = []

    class Field:
        def query(self, points, footprint):
            asked.append((points, footprint))
            return Brdf(points.copy(), points[:, 0] * 10, points[:, 1] * 10)

    got = voxel_materials(Field(), voxels)
    points, footprint = asked[0]
    np.testing.assert_array_equal(points, voxels["point"][[0, 2, 4, 5, 6]])
    np.testing.assert_allclose(footprint, 1.5)
    np.testing.assert_array_equal(got.base_color, voxels["point"][voxels["source"]])
    np.testing.assert_array_equal(got.roughness, 10 * voxels["point"][voxels["source"], 0])
    np.testing.assert_array_equal(got.metallic, 10 * voxels["point"][voxels["source"], 1])
