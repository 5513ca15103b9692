"""Masks of different views become segments by their overlap; numbers of instances mean nothing."""

import tracemalloc

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.stages.segment.associate import Masks, associated, contracted
from fipt.stages.segment.settings import FuseSettings

CELLS = 600
TRUE = np.repeat([0, 1, 2], CELLS // 3)
"""Three objects on a line of cells."""


def scene(views: int, seed: int, split_in: int | None = None, kinds=(0, 0, 0)):
    """Masks of views that each see a random stretch, with numbers of their own; ``split_in`` sees object 0 as two."""
    rng = np.random.default_rng(seed)
    rows, shown, truth = [], [], []
    for view in range(views):
        first = 20 * int(rng.integers(0, CELLS // 60))
        cell = np.arange(first, first + 2 * CELLS // 3)
        object_of = TRUE[cell].copy()
        if view == split_in:
            object_of[cell < (first + CELLS // 3) // 2] = 3
        number = rng.permutation(4) + 1
        present = np.unique(number[object_of])
        mask = len(rows) + np.searchsorted(present, number[object_of])
        for each in present:
            own = int(np.flatnonzero(number == each)[0])
            truth.append(own)
            rows.append((view, each, kinds[own % 3], int((number[object_of] == each).sum())))
        shown.append((cell, mask))
    masks = Masks(*np.array(rows, np.int64).T)
    return masks, (lambda view: shown[view]), np.array(truth)


@pytest.mark.parametrize("seed", range(4))
def test_permuted_numbers_find_together(seed: int) -> None:
    masks, cells_of, truth = scene(12, seed)
    segment = associated(masks, cells_of, CELLS, FuseSettings())
    for own in range(3):
        assert len(np.unique(segment[truth == own])) == 1
    assert len(np.unique(segment)) == 3


def test_a_view_that_splits_an_object_does_not_split_the_segment() -> None:
    masks, cells_of, truth = scene(12, 1, split_in=5)
    segment = associated(masks, cells_of, CELLS, FuseSettings())
    whole = truth == 0
    whole[masks.view == 5] = False
    assert len(np.unique(segment[whole])) == 1


def test_masks_of_one_view_stay_apart_though_a_third_view_takes_them_for_one() -> None:
    masks = Masks(np.array([0, 0, 1, 2, 2]), np.array([1, 2, 1, 1, 2]), np.zeros(5, np.int64), np.full(5, 100))
    half = np.arange(200) // 100
    shown = [(np.arange(200), half), (np.arange(200), np.full(200, 2)), (np.arange(200), 3 + half)]
    segment = associated(masks, lambda view: shown[view], 200, FuseSettings())
    assert segment[0] == segment[3]
    assert segment[1] == segment[4]
    assert segment[0] != segment[1]


def test_tiny_masks_are_left_out_and_other_ways_take_ids_or_classes() -> None:
    masks, cells_of, truth = scene(3, 0, kinds=(5, 6, 5))
    np.testing.assert_array_equal(associated(masks, cells_of, CELLS, FuseSettings(associate="ids")), masks.id)
    np.testing.assert_array_equal(associated(masks, cells_of, CELLS, FuseSettings(associate="classes")), masks.kind)
    few = Masks(masks.view, masks.id, np.zeros_like(masks.kind), np.where(truth == 1, 2, masks.pixels))
    assert (associated(few, cells_of, CELLS, FuseSettings())[truth == 1] == 0).all()
    with pytest.raises(FiptError, match=r"no view has classes; set fuse\.associate"):
        associated(few, cells_of, CELLS, FuseSettings(associate="classes"))


def test_memory_does_not_hold_the_pixels_of_all_views() -> None:
    views, pixels, width = 40, 50_000, 1000
    masks = Masks(np.arange(views), np.ones(views, int), np.zeros(views, int), np.full(views, pixels))

    def cells_of(view: int) -> tuple[np.ndarray, np.ndarray]:
        return np.arange(pixels) // width, np.full(pixels, view)

    tracemalloc.start()
    segment = associated(masks, cells_of, pixels // width, FuseSettings())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (segment == 1).all()
    assert peak < 100 * pixels


def test_contraction_joins_what_evidence_adds_up_to() -> None:
    # 0-1 strongly; 2 is drawn to 0 and pushed off by 1 more than that
    first, second, view = np.array([0, 0, 1]), np.array([1, 2, 2]), np.arange(3)
    np.testing.assert_array_equal(contracted(3, first, second, np.array([0.7, 0.3, -0.4]), view), [0, 0, 2])
    np.testing.assert_array_equal(contracted(3, first, second, np.array([0.7, 0.3, -0.2]), view), [0, 0, 0])
    np.testing.assert_array_equal(
        contracted(3, first, second, np.array([0.7, 0.3, 0.3]), np.array([0, 1, 1])), [0, 0, 2]
    )
