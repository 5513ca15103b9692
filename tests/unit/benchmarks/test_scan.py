"""Scan-like meshes of known rooms."""

import numpy as np
import pytest

from benchmarks import scan
from fipt.errors import FiptError
from fipt.scene.mesh import Mesh
from fipt.synthetic.shapes import ball, box, joined


def room(size: float = 2.0) -> Mesh:
    """A box seen from inside, its centre at the origin, with a ball on the floor."""
    walls = box((size, size, size)).moved(0, -size / 2, 0)
    walls = type(walls)(walls.vertices, walls.triangles[:, ::-1], walls.uv)
    shape = joined([walls, ball(0.3, 32).moved(0.3, -0.65, 0.2)])
    return Mesh(shape.vertices.astype(np.float32), shape.triangles.astype(np.int32))


@pytest.fixture(scope="module")
def camera():
    return scan.depth_camera(np.eye(4))


@pytest.fixture(scope="module")
def scanned(backend, camera):
    return scan.scanned(room(), [camera], scan.ScanSettings(voxel=0.05, noise=0.0, views=16))


def off_true(vertices: np.ndarray) -> np.ndarray:
    """Distance of (N, 3) points to walls or ball, metres."""
    wall = np.abs(1.0 - np.abs(vertices)).min(axis=1)
    return np.minimum(wall, np.abs(np.linalg.norm(vertices - (0.3, -0.65, 0.2), axis=1) - 0.3))


def test_the_scan_lies_on_the_true_surface_and_faces_free_space(scanned):
    assert np.percentile(off_true(scanned.vertices), 95) < 0.05
    centers = scanned.corners.mean(axis=1)
    reach = np.sort(np.abs(centers), axis=1)
    flat = (reach[:, 2] > 0.95) & (reach[:, 1] < 0.85) & (np.linalg.norm(centers - (0.3, -0.65, 0.2), axis=1) > 0.5)
    toward = -np.sign(centers[flat]) * (np.abs(centers[flat]) > 0.95)
    assert ((scanned.normals[flat] * toward).sum(axis=1) > 0.9).mean() > 0.98
    # What is seen is meshed, but for holes where walls meet.
    assert 0.7 < scanned.areas.sum() / (24 + 4 * np.pi * 0.09) < 1.05


def test_noise_moves_it(backend, camera, scanned):
    noisy = scan.scanned(room(), [camera], scan.ScanSettings(voxel=0.05, noise=0.05, views=16))
    assert off_true(noisy.vertices).mean() > 2 * off_true(scanned.vertices).mean()


def test_a_sphere_is_closed_by_surface_nets():
    axis = np.arange(-12, 13) * 0.1
    grid = np.sqrt((np.stack(np.meshgrid(axis, axis, axis, indexing="ij")) ** 2).sum(axis=0)) - 0.9
    mesh = scan.surface_nets(grid.astype(np.float32), np.full(3, -1.2), 0.1)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 0.9, atol=0.01)
    corners = mesh.corners.astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.9**3, rel=0.02)
    edges = np.sort(
        np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]]), axis=1
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_small_pieces_are_dropped():
    large, small = ball(1.0, 24), box((0.1, 0.1, 0.1)).moved(3, 0, 0)
    shape = joined([small, large])
    mesh = scan.without_crumbs(Mesh(shape.vertices.astype(np.float32), shape.triangles.astype(np.int32)))
    assert mesh.vertices[:, 0].max() < 1.1
    assert mesh.triangles.max() == len(mesh.vertices) - 1


def test_no_free_space_is_said(backend, camera):
    with pytest.raises(FiptError, match="free space"):
        scan.scanned(room(0.4), [camera], scan.ScanSettings(voxel=0.05, views=2))
