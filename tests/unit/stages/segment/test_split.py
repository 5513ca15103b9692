"""Cells: large triangles are cut, the surface stays the same and closed."""

import numpy as np
import pytest

from fipt.scene.mesh import Mesh
from fipt.stages.segment.split import split, whole
from tests.scenes import QUAD, box, quad


def sides(mesh: Mesh) -> np.ndarray:
    corners = mesh.corners.astype(float)
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def uses_of_sides(mesh: Mesh) -> np.ndarray:
    """How many triangles have each side, by the places of its ends."""
    place = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.triangles]
    ends = np.sort(np.stack([place, np.roll(place, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    return np.unique(ends, axis=0, return_counts=True)[1]


def test_cells_keep_area_winding_and_parents_and_are_small() -> None:
    mesh = box((0, 0, 0), (4, 3, 0.01))  # slivers included
    cells = split(mesh, np.ones(12, bool), 0.2, 10**6)
    assert sides(cells.mesh).max() <= 0.2
    assert cells.size == 0.2
    assert (np.diff(cells.parent) >= 0).all()
    np.testing.assert_allclose(np.bincount(cells.parent, cells.area), mesh.areas, rtol=1e-5)
    np.testing.assert_allclose(cells.mesh.normals, mesh.normals[cells.parent], atol=1e-3)


@pytest.mark.parametrize("chosen", [range(12), [3], [0, 5]])
def test_a_closed_surface_stays_closed_whichever_triangles_are_cut(chosen) -> None:
    mesh = box((0, 0, 0), (4, 3, 5))
    mask = np.zeros(12, bool)
    mask[list(chosen)] = True
    cells = split(mesh, mask, 0.5, 10**6)
    assert (uses_of_sides(cells.mesh) == 2).all()
    assert sides(cells.mesh)[mask[cells.parent]].max() <= 0.5


def test_triangles_away_from_the_chosen_ones_stay_whole() -> None:
    mesh = box((0, 0, 0), (1, 1, 1))
    mask = np.arange(12) == 0
    cells = split(mesh, mask, 0.3, 10**6)
    counts = np.bincount(cells.parent, minlength=12)
    assert counts[0] > 8
    corner_sets = mesh.corners.reshape(12, 9)
    first = {tuple(c) for c in mesh.corners[0]}
    apart = [t for t in range(12) if sum(tuple(c) in first for c in mesh.corners[t]) < 2]
    assert apart
    assert (counts[apart] == 1).all()
    for t in apart:
        np.testing.assert_array_equal(cells.mesh.corners[cells.parent == t].reshape(-1), corner_sets[t])


def test_the_number_of_cells_is_bounded() -> None:
    mesh = quad((0, 0, 0), (4, 0, 0), (0, 3, 0))
    cells = split(mesh, np.ones(2, bool), 0.001, 2000)
    assert 200 < len(cells) < 6000
    assert cells.size > 0.001


def test_nothing_is_cut_where_nothing_is_large_or_chosen() -> None:
    mesh = Mesh(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)).vertices, QUAD)
    for cells in (whole(mesh), split(mesh, np.zeros(2, bool), 0.1, 100), split(mesh, np.ones(2, bool), 9.0, 100)):
        assert cells.mesh is mesh
        np.testing.assert_array_equal(cells.parent, [0, 1])
