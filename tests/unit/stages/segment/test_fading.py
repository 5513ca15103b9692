"""Regions that fade into each other are of one material; those with an edge between them are two."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from fipt.stages.segment.fading import fading
from fipt.stages.segment.material_evidence import MATTE, TRIALS, ColorPieces, MaterialEvidence, comparable
from fipt.stages.segment.regroup import _with_fading

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
        owner, voxel, 0.05 * voxel, owner.copy(), 9 * ones, ones, ones > 0, 0.01 * np.ones(same.shape[:2]), same
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


def test_the_largest_material_gives_its_own(np_rng):
    np.testing.assert_array_equal(material(wall(np_rng, light_that_is_missing, border=15)), [7, 7])
    np.testing.assert_array_equal(material(wall(np_rng, light_that_is_missing, border=25)), [4, 4])
    piece = wall(np_rng, light_that_is_missing, border=15)
    elsewhere = 3 * 15 * 24  # of the same paint, on another wall
    pieces = pieces_of(
        np.concatenate([piece.voxel, [0, 0, 50] + piece.voxel[np.arange(elsewhere) % len(piece.voxel)]]),
        np.concatenate([piece.owner, np.full(elsewhere, 2)]),
        np.concatenate([piece.color[:, MATTE], np.repeat(piece.color[:1, MATTE], elsewhere, axis=0)]),
    )
    found = fading(pieces, np.array([4, 7, 4]), np.full((3, 3), 0.05**2), np.zeros(3, bool))
    np.testing.assert_array_equal(found, [4, 4, 4])


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


def test_an_edge_along_another_wall_counts(np_rng):
    """Two regions around a corner: along one wall they fade into each other, along the other one they do not."""
    short = wall(np_rng, light_that_is_missing, up=14)
    long = wall(np_rng, two_paints, up=60)
    turned = long.voxel[:, [2, 1, 0]] + [60, 0, 0]
    owner = np.concatenate([short.owner, long.owner])
    color = np.concatenate([short.color[:, MATTE], long.color[:, MATTE]])
    pieces = pieces_of(np.concatenate([short.voxel, turned]), owner, color)
    facing = np.repeat([0, 2], [len(short.owner), len(long.owner)])
    both = replace(pieces, key=facing * 2 + owner)
    np.testing.assert_array_equal(material(both), [4, 7])
    np.testing.assert_array_equal(material(replace(pieces, judged=facing == 0, key=both.key)), [7, 7])


def test_what_gloss_keeps_apart_does_not_join_by_colour(np_rng):
    """No edge shows between two regions of one colour, and that says nothing."""
    for _ in range(20):
        np.testing.assert_array_equal(material(wall(np_rng, lambda column: np.ones((len(column), 1)) * WHITE)), [4, 7])


def test_a_faint_edge_stays_whatever_light_is_missing(np_rng):
    brighter = lambda column: light_that_is_missing(column) * np.where(column < 20, 1, 1.25)[:, None]  # noqa: E731
    np.testing.assert_array_equal(material(wall(np_rng, brighter, noise=0.02)), [4, 7])


def test_regions_that_do_not_stay_keep_the_numbers_of_the_others(np_rng):
    """Of three regions the second is left out, as one that its copies made metal; the two others fade."""
    pieces = wall(np_rng, light_that_is_missing, border=15)
    shifted = replace(pieces, owner=2 * pieces.owner, key=2 * pieces.owner)
    evidence = SimpleNamespace(metal=np.zeros(2, bool), variance=np.full((2, 3), 0.05**2))
    label = _with_fading(shifted, np.array([True, False, True]), cast(MaterialEvidence, evidence), np.array([0, 1]))
    np.testing.assert_array_equal(label, [0, 0])
