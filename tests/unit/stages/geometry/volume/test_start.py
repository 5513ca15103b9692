"""Distances in blocks of voxels: as a field's start, and as a mesh; the sphere."""

import numpy as np
import pytest
import torch

from fipt.model.networks import SceneBox
from fipt.stages.geometry.mesh_settings import RefinedGeometry
from fipt.stages.geometry.tsdf import BLOCK
from fipt.stages.geometry.volume.blocks import BlockGrid
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.isosurface import changed_by
from fipt.stages.geometry.volume.start import BlockDistance, Sphere

NORMAL = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
OFFSET = 0.05
VOXEL = 0.02
BOX = SceneBox((0.1, 0.0, -0.1), 1.2)
SMALL = RefinedGeometry(levels=2, finest=32, table_log2=10, width=8)


@pytest.fixture
def slanted() -> BlockGrid:
    """Blocks around the origin that hold the distance to a slanted plane."""
    axis = np.arange(-2, 3, dtype=np.int32)
    blocks = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    empty = np.zeros((len(blocks), BLOCK**3), np.float32)
    grid = BlockGrid(blocks, empty, np.ones(empty.shape, bool), VOXEL)
    empty[:] = (grid.places(slice(None)) @ NORMAL - OFFSET).reshape(empty.shape)
    return grid


def test_distances_between_voxels_are_linear(slanted, np_rng):
    start = BlockDistance(slanted, BOX)
    places = np_rng.uniform(-2 * BLOCK * VOXEL, 3 * BLOCK * VOXEL - 1.01 * VOXEL, (500, 3))
    signed = torch.from_numpy(BOX.to_signed(places).astype(np.float32))
    np.testing.assert_allclose(start(signed).numpy() * BOX.side / 2, places @ NORMAL - OFFSET, atol=1e-5)
    outside = start(torch.full((1, 3), 0.99))
    assert float(outside) == pytest.approx(slanted.distance.min() / (BOX.side / 2))


@pytest.mark.usefixtures("open3d")
def test_the_zero_of_blocks_is_a_mesh_that_faces_free_space(slanted):
    mesh = slanted.surface()
    np.testing.assert_allclose(mesh.vertices @ NORMAL, OFFSET, atol=1e-5)
    assert (mesh.normals @ NORMAL > 0.999).all()


def test_a_field_begins_with_its_start(slanted):
    field = VolumeField(BlockDistance(slanted, BOX), SMALL, 0.01)
    same = changed_by(field, slanted, BOX, 0.01)
    np.testing.assert_allclose(same.distance, slanted.distance, atol=1e-5)


def test_gradients_of_a_sphere_point_inwards(np_rng):
    field = VolumeField(Sphere(), SMALL, 0.1)
    places = torch.from_numpy(np_rng.uniform(-0.9, 0.9, (50, 3)).astype(np.float32))
    there = field.around(places, 1e-2)
    inward = -torch.nn.functional.normalize(places, dim=1)
    far = places.norm(dim=1) > 0.4  # four places tell a gradient but for the step times the curvature
    torch.testing.assert_close(there.gradient[far], inward[far], atol=0.02, rtol=0.0)
    torch.testing.assert_close(there.distance, 0.9 - places.norm(dim=1), atol=2e-3, rtol=0.0)


def test_radiance_alone_is_learned_while_the_surface_stays(np_rng):
    field = VolumeField(Sphere(), SMALL, 0.1)
    field.learns_distance = False
    places = torch.from_numpy(np_rng.uniform(-0.9, 0.9, (50, 3)).astype(np.float32))
    there = field.around(places, 1e-2)
    assert not there.distance.requires_grad
    assert field.radiance(places, places, there).requires_grad
