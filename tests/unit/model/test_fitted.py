"""The fitted scene: loaded from its files, asked for reflectance; materials of the cache's voxels."""

import numpy as np
import pytest
import torch

from fipt.errors import FiptError
from fipt.model.fitted import FittedScene, voxel_materials
from fipt.model.networks import Brdf, Field, SceneBox
from fipt.model.settings import NetworkSettings
from fipt.model.store import save_field
from fipt.scene.emitters import Emitters, write_emitters
from fipt.scene.environment import NOTHING, constant, write_environment
from fipt.scene.voxels import facing_normals, write_cache
from tests import scenes

SETTINGS = NetworkSettings(levels=2, table_log2=8, footprint=0.25)


def test_a_scene_is_loaded_from_the_files_of_its_round(tmp_path):
    mesh, model = scenes.room().mesh, Field(SETTINGS, SceneBox((0.0, 0.0, 0.0), 4.0))
    one = np.ones(1, np.float32)
    emitters = Emitters(
        np.int32([3]), np.ones((1, 3), np.float32), one, np.int32([0]), np.int32([2]), one, one, one > 1
    )
    save_field(tmp_path / "model.safetensors", model, SETTINGS)
    write_emitters(tmp_path / "emitters.npz", emitters, mesh)
    write_environment(tmp_path / "environment.npz", constant((1.0, 2.0, 3.0)))
    write_cache(tmp_path / "cache.npz", scenes.grid(resolution=2, side=3.0))
    bare = FittedScene.load(mesh, tmp_path / "model.safetensors")
    assert (len(bare.emitters.triangle), bare.environment, bare.cache) == (0, NOTHING, {})
    names = ("model.safetensors", "emitters.npz", "environment.npz", "cache.npz")
    found = FittedScene.load(mesh, *(tmp_path / name for name in names))
    assert found.mesh is mesh
    assert found.model.settings == SETTINGS
    assert found.emitters.triangle.tolist() == [3]
    assert found.environment.mean.tolist() == pytest.approx([1, 2, 3])
    assert len(found.cached_materials().roughness) == len(found.cache["key"]) == 8
    with pytest.raises(FiptError, match=r"none\.npz"):
        FittedScene.load(mesh, tmp_path / "model.safetensors", tmp_path / "none.npz")


def test_the_model_is_asked_about_the_share_of_a_pixel_that_it_was_fitted_with():
    model = Field(SETTINGS, SceneBox((0.0, 0.0, 0.0), 1.0))
    with torch.no_grad():
        model.brdf_network.encoding.table.mul_(1e4)
    points, width = np.float32([[0.1, 0.2, 0.3], [-0.4, 0.1, 0.2]]), np.float32([0.5, 0.1])
    up = np.float32([[0, 0, 1], [0, 0, 1]])
    asked = FittedScene(scenes.room().mesh, model).reflectance(points, up, width)
    np.testing.assert_array_equal(asked.base_color, model.query(points, 0.25 * width).base_color)
    assert (asked.base_color != model.query(points, width).base_color).any()
    model.learn_finest(points[:1], np.float32([0.3]))  # the views were coarser there: a closer one shows no more
    asked = FittedScene(scenes.room().mesh, model).reflectance(points, up, width)
    np.testing.assert_array_equal(asked.base_color, model.query(points, np.float32([0.3, 0.025])).base_color)


def test_a_model_is_asked_below_the_surface():
    model = Field(SETTINGS, SceneBox((0.0, 0.0, 0.0), 1.0), inset=0.02)
    with torch.no_grad():
        model.brdf_network.encoding.table.mul_(1e4)
    edge, width = np.float32([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]]), np.full(2, 0.01, np.float32)
    normals = np.float32([[0, 0, 1], [1, 0, 0]])
    asked = FittedScene(scenes.room().mesh, model).reflectance(edge, normals, width)
    below = np.float32([[0.1, 0.2, 0.28], [0.08, 0.2, 0.3]])
    np.testing.assert_allclose(asked.base_color, model.query(below, 0.25 * width).base_color, rtol=1e-5)
    assert (asked.base_color[0] != asked.base_color[1]).all(), "the two sides of an edge share no place"


def test_unseen_voxels_take_the_material_of_the_one_that_stands_for_them():
    voxels = scenes.grid(resolution=2, side=3.0)
    voxels["source"] = np.array([0, 0, 2, 2, 4, 5, 6, 0], np.int32)
    asked, placed = [], []

    class Asked:
        def place(self, points, normals):
            placed.append(normals)
            return points

        def query(self, points, footprint):
            asked.append((points, footprint))
            return Brdf(points.copy(), points[:, 0] * 10, points[:, 1] * 10)

    got = voxel_materials(Asked(), voxels)
    points, footprint = asked[0]
    np.testing.assert_array_equal(points, voxels["point"][[0, 2, 4, 5, 6]])
    np.testing.assert_array_equal(placed[0], facing_normals(voxels["facing"][[0, 2, 4, 5, 6]]))
    np.testing.assert_allclose(footprint, 1.5)
    np.testing.assert_array_equal(got.base_color, voxels["point"][voxels["source"]])
    np.testing.assert_array_equal(got.roughness, 10 * voxels["point"][voxels["source"], 0])
    np.testing.assert_array_equal(got.metallic, 10 * voxels["point"][voxels["source"], 1])
