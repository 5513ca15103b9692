"""The graph of cells: neighbours and angles, filling, islands, pieces."""

import numpy as np
import pytest

from fipt.scene.mesh import Mesh
from fipt.stages.segment.split import split
from fipt.stages.segment.surface import filled, near_pieces, surface_of, tidied
from tests.scenes import box, joined, quad, turned


def strip(count: int, x: float = 0.0) -> Mesh:
    """A row of ``count`` unit squares along x, two triangles each."""
    return joined(*(quad((x + k, 0, 0), (1, 0, 0), (0, 1, 0)) for k in range(count)))


@pytest.mark.parametrize("mesh", [box((0, 0, 0), (1, 2, 3)), turned(box((0, 0, 0), (1, 2, 3)))])
def test_a_box_bends_by_a_right_angle_at_its_edges_and_not_on_its_diagonals(mesh: Mesh) -> None:
    surface = surface_of(mesh)
    assert len(surface.pairs) == 18
    wall = surface.pairs // 2
    flat = wall[:, 0] == wall[:, 1]
    np.testing.assert_allclose(surface.bend[flat], 1, atol=1e-6)
    np.testing.assert_allclose(surface.bend[~flat], 0, atol=1e-6)
    assert flat.sum() == 6
    assert surface.border[~flat].sum() == pytest.approx(4 * (1 + 2 + 3))


def test_a_fold_is_known_whichever_way_triangles_are_wound() -> None:
    vertices = np.float32([[0, 0, 0], [0, 1, 0], [1, 0, 0], [np.cos(2.0), 0, np.sin(2.0)]])
    for second in ([0, 1, 3], [1, 0, 3]):
        surface = surface_of(Mesh(vertices, np.int32([[0, 1, 2], second])))
        np.testing.assert_allclose(surface.bend, [np.cos(np.pi - 2.0)], atol=1e-6)


def test_holes_take_the_nearest_id_of_their_smooth_region_only() -> None:
    mesh = box((0, 0, 0), (4, 3, 5))
    cells = split(mesh, np.ones(12, bool), 0.4, 10**6)
    surface = surface_of(cells.mesh)
    wall = cells.parent // 2
    x = surface.center[:, 0]
    ids = np.zeros(len(cells), np.int64)
    ids[(wall == 2) & (x < 0.5)] = 7  # two ends of the wall -y
    ids[(wall == 2) & (x > 3.5)] = 9
    found = filled(surface, ids, surface.bend > 0.9)
    assert (found[wall != 2] == 0).all()
    own = wall == 2
    far = np.abs(x - 2) > 0.4
    np.testing.assert_array_equal(found[own & far], np.where(x < 2, 7, 9)[own & far])
    assert (found[own] > 0).all()
    np.testing.assert_array_equal(filled(surface, np.zeros_like(ids), surface.bend > 0.9), 0)


def test_small_islands_go_and_segments_of_their_own_stay_where_votes_agree() -> None:
    mesh = strip(10)
    surface = surface_of(mesh)
    ids = np.repeat([1, 1, 1, 2, 1, 1, 3, 3, 1, 1], 2)
    sure = np.ones(20)
    kept = tidied(surface, ids, sure, 1.5)
    np.testing.assert_array_equal(kept, ids)  # 2 is small, but all that there is of it
    unsure = np.where(ids == 2, 0.4, 1.0)
    np.testing.assert_array_equal(tidied(surface, ids, unsure, 1.5), np.where(ids == 2, 1, ids))
    np.testing.assert_array_equal(tidied(surface, ids, unsure, 0.5), ids)
    stray = np.repeat([1, 1, 1, 3, 1, 1, 3, 3, 1, 1], 2)  # a second, smaller piece of 3
    np.testing.assert_array_equal(tidied(surface, stray, sure, 1.5)[6:8], 1)


def test_pieces_hang_together_by_touch_or_by_a_small_gap() -> None:
    mesh = joined(strip(2), strip(1, x=2.04), strip(1, x=8))
    surface = surface_of(mesh)
    ids = np.repeat([1, 1, 1, 1], 2)
    cells = split(mesh, np.ones(8, bool), 0.05, 10**6)
    fine = surface_of(cells.mesh)
    piece = near_pieces(fine, ids[cells.parent], 0.3)
    square = cells.parent // 2
    assert len(np.unique(piece[square < 3])) == 1
    assert len(np.unique(piece)) == 2
    other = near_pieces(surface, np.repeat([1, 2, 0, 1], 2), 0.3)
    assert len({other[0], other[2], other[6]}) == 3
    np.testing.assert_array_equal(other[4:6], -1)
