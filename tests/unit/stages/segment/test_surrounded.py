"""Pieces of a mirror that do not tell, between pieces that do."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.scene.mesh import Mesh
from fipt.stages.segment.material_evidence import HALF, TRIALS, MaterialEvidence
from fipt.stages.segment.surrounded import with_surrounded

CLEAR_METAL, WEAK_METAL, UNTOLD, DIELECTRIC, NOISY = "clear metal", "weak metal", "untold", "dielectric", "noisy"
LEFT = {
    CLEAR_METAL: (2.0, 1.0, 0.1),
    WEAK_METAL: (2.0, 1.0, 0.9),
    UNTOLD: (1.0, 1.01, 0.2),
    DIELECTRIC: (1.0, 2.0, 0.1),
    NOISY: (1.0, 2.0, 3.0),
}
"""What the best dielectric and the best metal leave, and the standard error of the difference."""


def strip(heights) -> Mesh:
    """Squares of 1 m in a row along x; the ends of the row's lines have these ``heights``."""
    x = np.arange(len(heights), dtype=float)
    rows = [np.column_stack([x, np.asarray(heights, float), np.full(len(x), z)]) for z in (0.0, 1.0)]
    first = np.arange(len(heights) - 1)
    lower = np.column_stack([first, first + len(x), first + 1])
    upper = np.column_stack([first + 1, first + len(x), first + len(x) + 1])
    return Mesh(np.float32(np.concatenate(rows)), np.stack([lower, upper], axis=1).reshape(-1, 3).astype(np.int32))


def evidence_of(kinds) -> MaterialEvidence:
    count = len(kinds)
    left, products = np.full((count, len(TRIALS)), 3.0), np.zeros((count, len(TRIALS), len(TRIALS)))
    for row, kind in enumerate(kinds):
        left[row, 2], left[row, HALF + 1], error = LEFT[kind]
        # independent noise of the trials: twice that of each is that of their difference
        products[row] = np.eye(len(TRIALS)) * error**2 / 2
    metal = np.array([kind in (CLEAR_METAL, WEAK_METAL) for kind in kinds])
    many, some = np.full(count, 400.0), np.full((count, 3), 0.01)
    return MaterialEvidence(left, products, np.zeros((count, len(TRIALS), 3)), many, many, 0 * many, metal, some)


def metals(kinds, heights=None, regions=None, **changed) -> list[bool]:
    """Which regions are metal after all; region 5 is the first square, 6 the next ..."""
    mesh = strip(np.zeros(len(kinds) + 1) if heights is None else heights)
    region = np.repeat(np.arange(len(kinds)) + 5, 2) if regions is None else regions
    known, counted = np.arange(len(kinds)) + 5, changed.pop("counted", np.ones(len(kinds), bool))
    evidence = replace(evidence_of(kinds), **changed)
    return with_surrounded(evidence, mesh, region, known, counted).metal.tolist()


def test_what_does_not_tell_between_clear_metals_is_metal():
    assert metals([CLEAR_METAL, UNTOLD, CLEAR_METAL]) == [True] * 3


@pytest.mark.parametrize("second", [UNTOLD, WEAK_METAL])
def test_it_is_a_clear_neighbour_in_turn(second):
    row = [CLEAR_METAL, second, UNTOLD, CLEAR_METAL]
    assert not metals(row)[2], "half of its border is not more"
    # all that the second touches is clear, and then so is all that the third touches
    assert metals(row, regions=np.array([5, 6, 6, 5, 6, 7, 7, 6])) == [True] * 4


@pytest.mark.parametrize("beside", [WEAK_METAL, UNTOLD, DIELECTRIC])
def test_other_neighbours_say_nothing(beside):
    assert not metals([beside, UNTOLD, beside])[1]
    assert not metals([CLEAR_METAL, UNTOLD, beside])[1], "half of the border"


def test_what_tells_stays_what_it_is():
    assert metals([CLEAR_METAL, DIELECTRIC, CLEAR_METAL]) == [True, False, True]
    assert metals([DIELECTRIC, WEAK_METAL, DIELECTRIC]) == [False, True, False]


def test_a_dielectric_by_less_than_shading_errs_by_does_not_tell():
    row = [CLEAR_METAL, NOISY, CLEAR_METAL]
    assert metals(row) == [True, False, True]
    assert metals(row, usual=np.full(3, 8.0)) == [True] * 3


def test_what_no_pixel_judges_stays_what_it_is():
    row = [CLEAR_METAL, UNTOLD, CLEAR_METAL]
    assert not metals(row, judged=np.array([400.0, 0, 400]))[1]
    assert not metals(row, counted=np.array([True, False, True]))[1], "most of its pixels are beside an emitter"


def test_a_frame_that_stands_out_is_no_neighbour():
    assert not metals([CLEAR_METAL, UNTOLD, CLEAR_METAL], heights=[1, 0, 0, 1])[1]


def test_border_with_a_region_of_which_no_pixel_tells_counts_against_it():
    row = [CLEAR_METAL, UNTOLD, CLEAR_METAL]
    assert not metals(row, regions=np.array([5, 5, 6, 6, 9, 9]))[1]
    assert metals(row, regions=np.array([5, 5, 6, 6, 0, 0]))[1], "surface of no region lies along all borders"
    assert metals(row, regions=np.array([5, 5, 6, 6]))[1], "what no pixel shows is missing at the end"


def test_a_room_without_a_clear_metal_stays_as_it_is():
    evidence = evidence_of([WEAK_METAL, UNTOLD])
    ids = np.array([5, 5, 6, 6])
    assert with_surrounded(evidence, strip(np.zeros(3)), ids, np.array([5, 6]), np.ones(2, bool)) is evidence
