"""Triangles change over to the part beside them that explains them."""

import numpy as np
import pytest

from fipt.conventions import SUB_POSITIONS
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import FootprintSamples
from fipt.stages.segment.borders import borders_moved
from fipt.stages.segment.region_pixels import RegionPixels
from tests.unit.stages.segment.test_regroup import RED, WHITE, pixels

GRID = 12


def floor(columns: int) -> Mesh:
    """Squares of a twelfth of a metre, each of two triangles: ``columns`` metres by one."""
    x, y = np.meshgrid(np.arange(columns * GRID + 1), np.arange(GRID + 1), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) / GRID
    corner = (np.arange(columns * GRID)[:, None] * (GRID + 1) + np.arange(GRID)).ravel()
    right, up = corner + GRID + 1, corner + 1
    triangles = np.stack([np.c_[corner, right, right + 1], np.c_[corner, right + 1, up]], axis=1).reshape(-1, 3)
    return Mesh(vertices.astype(np.float32), triangles.astype(np.int32))


def moved(found: RegionPixels, grown: np.ndarray) -> np.ndarray:
    """(N,) parts of pixels (N,) after borders moved; every second pixel shows the upper triangle of its square."""
    count = len(grown)
    square = np.floor(found.place[:, :2] * GRID).astype(np.int64)
    samples = FootprintSamples(
        views=("a",),
        shapes=((1, count),),
        offsets=np.arange(count + 1),
        center=np.ones(count, np.uint8),
        position=found.place,
        normal=found.normal.astype(np.float32),
        triangle=2 * (square[:, 0] * GRID + square[:, 1]) + np.arange(count) % 2,
        footprint=np.full(count, 1 / GRID, np.float32),
        weight=np.ones(count, np.float32),
        sub=np.zeros((count, SUB_POSITIONS, 3), np.float16),
        sub_triangle=np.zeros((count, SUB_POSITIONS), np.int32),
    )
    shard = ObservedShard(samples, found.shading, found.radiance, np.ones(count), np.zeros(count, bool))
    (after,) = borders_moved(floor(3), [shard], [grown.astype(np.uint16)])
    return after


@pytest.mark.parametrize("second", [(WHITE, 0.1, 1.0), (RED, 0.8, 0.0)], ids=["a mirror", "another colour"])
def test_a_border_moves_to_where_materials_meet(np_rng, second):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), second, (WHITE, 0.8, 0.0)], grid=GRID)
    truth = np.where(found.region == 1, 2, 1)
    # half of the second material is taken for the first, and a strip of the other side for the second
    grown = np.where((found.place[:, 0] > 1.5) & (found.place[:, 0] < 2.2), 2, 1)
    assert np.mean(grown == truth) < 0.8
    assert np.mean(moved(found, grown) == truth) > 0.98


def test_a_border_without_evidence_stays(np_rng):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0)] * 3, grid=GRID)
    grown = np.where(found.place[:, 0] < 1.5, 1, 2)
    assert (moved(found, grown) == grown).mean() > 0.98


def test_pixels_that_their_triangle_does_not_speak_for_keep_their_part(np_rng):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), (RED, 0.8, 0.0), (WHITE, 0.8, 0.0)], grid=GRID)
    grown = np.where((found.place[:, 0] > 1.5) & (found.place[:, 0] < 2), 2, 1)
    odd = np.flatnonzero((found.place[:, 0] > 1.1) & (found.place[:, 0] < 1.4))[::50]
    grown[odd] = 3
    assert (moved(found, grown)[odd] == 3).all()
