"""Regions that fade into each other are of one material; those with an edge between them are two."""

import numpy as np
import pytest

from fipt.stages.segment.fading import fading
from fipt.stages.segment.material_evidence import TRIALS, ColorPieces, comparable

WHITE, GREY = np.array([0.6, 0.62, 0.58]), np.array([0.4, 0.41, 0.39])


def wall(rng, brighter, across=40, up=24, border=20, noise=0.05):
    """Pieces of a wall, of two regions left and right of a border, in the colours that ``brighter`` (column) gives."""
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(across), np.arange(up)))
    voxel = np.stack([column, row, np.zeros(len(column), np.int64)], axis=1)
    color = brighter(column) * np.exp(noise * rng.standard_normal((len(column), 1)))
    return pieces_of(voxel, (column >= border).astype(np.int64), comparable(color))


def pieces_of(voxel, owner, color):
    count = len(owner)
    same = np.repeat(color[:, None], len(TRIALS), axis=1)
    ones = np.ones(count)
    return ColorPieces(
        owner, voxel, 0.05 * voxel, owner.copy(), 9 * ones, ones > 0, 0.01 * np.ones(same.shape[:2]), same
    )


def material(pieces, metal=(False, False), label=(4, 7)):
    return fading(pieces, np.array(label), np.full((2, 3), 0.05**2), np.array(metal))


def light_that_is_missing(column):
    """Ever brighter to the right, where a lamp shines that nobody knows of."""
    return np.exp(0.03 * np.maximum(column - 12, 0))[:, None] * WHITE


def two_paints(column):
    return np.where((column < 20)[:, None], GREY, WHITE)


def test_a_wall_below_an_unknown_lamp_is_of_the_wall(np_rng):
    pieces = wall(np_rng, light_that_is_missing)
    np.testing.assert_array_equal(material(pieces), [7, 7])


def test_the_largest_region_gives_the_material(np_rng):
    pieces = wall(np_rng, light_that_is_missing, border=15)
    np.testing.assert_array_equal(material(pieces), [7, 7])


def test_two_paints_are_two(np_rng):
    pieces = wall(np_rng, two_paints)
    np.testing.assert_array_equal(material(pieces), [4, 7])


def test_two_paints_under_light_that_is_missing_are_two(np_rng):
    pieces = wall(np_rng, lambda column: two_paints(column) * light_that_is_missing(column))
    np.testing.assert_array_equal(material(pieces), [4, 7])


def test_another_hue_is_another_paint(np_rng):
    """As bright at the border as its neighbour, and brighter in the mean."""
    warm = np.exp([0.3, 0.0, -0.3])
    pieces = wall(np_rng, lambda column: light_that_is_missing(column) * np.where((column < 20)[:, None], 1, warm))
    np.testing.assert_array_equal(material(pieces), [4, 7])


@pytest.mark.parametrize("metal", [[True, False], [False, True]])
def test_metal_does_not_fade(np_rng, metal):
    pieces = wall(np_rng, light_that_is_missing)
    np.testing.assert_array_equal(material(pieces, metal), [4, 7])


def test_a_short_border_tells_nothing(np_rng):
    pieces = wall(np_rng, light_that_is_missing, up=6)
    np.testing.assert_array_equal(material(pieces), [4, 7])


def test_regions_of_one_material_stay(np_rng):
    pieces = wall(np_rng, light_that_is_missing)
    np.testing.assert_array_equal(material(pieces, label=(4, 4)), [4, 4])
