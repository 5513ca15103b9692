"""Sums of records over views, and what one view alone shows."""

import numpy as np
import pytest

from fipt.stages.cache.sums import Samples, Sums, beside_nearer, most_pairs
from tests import scenes

MIXED = 1e-3
ROOM = 100
"""Records of surface beside the one that is asked, of radiance 1."""


def summed(views, weights=None, clipped=None, beside=False):
    """Mean radiance of record 0, of which each view shows one sample of a radiance; all others are elsewhere."""
    sums = Sums(np.arange(ROOM + 1), MIXED)
    for index, value in enumerate(views):
        radiance = np.ones((ROOM + 1, 3), np.float32)
        radiance[0] = value
        weight = np.ones(ROOM + 1)
        weight[0] = 1.0 if weights is None else weights[index]
        bound = np.zeros(ROOM + 1, bool)
        bound[0] = clipped is not None and clipped[index]
        sums.add(Samples(np.arange(ROOM + 1), radiance, weight, bound, np.full(ROOM + 1, beside)))
    sums.finish()
    mean = sums.total / sums.weight[:, None]
    np.testing.assert_allclose(mean[1:], 1.0)
    assert 0 <= sums.cut < 1
    return mean[0, 0]


@pytest.mark.parametrize("dark", [0.5, 2.0])
def test_a_lamp_that_one_view_shows_behind_its_mesh_is_cut(dark):
    usual = max(dark, 1.0)  # the room's surface is as bright as 1
    assert summed([dark, dark, 100.0]) == pytest.approx((2 * dark + 5 * usual) / 3)
    assert summed([100.0, dark]) == pytest.approx((dark + 5 * usual) / 2)


def around(values, beside, cells=(0, 0, 0)):
    """Radiance of records that one view each shows."""
    sums = Sums(np.array(cells), MIXED)
    for record, value in enumerate(values):
        sample = np.array([record]), np.full((1, 3), value, np.float32), np.ones(1), np.zeros(1, bool)
        sums.add(Samples(*sample, np.array([beside])))
    sums.finish()
    return (sums.total / sums.weight[:, None])[:, 0]


def test_beside_something_nearer_other_views_around_tell():
    np.testing.assert_allclose(around([1.0, 2.0, 100.0], beside=True), [1, 2, 2])
    np.testing.assert_allclose(around([0.01, 1.0, 2.0, 100.0], beside=True, cells=(0, 1, 2, 0)), [0.01, 1, 2, 1.5])
    np.testing.assert_allclose(around([1.0, 2.0, 100.0], beside=False), [1, 2, 100])  # a spot in a ceiling
    np.testing.assert_allclose(around([1.0, 2.0, 100.0], beside=True, cells=(0, 0, 1)), [1, 2, 100])  # nobody tells
    np.testing.assert_allclose(around([90.0, 1.0, 100.0], beside=True), [90, 1, 100])  # a lamp behind a bar


def test_what_is_beside_something_nearer():
    """Two rows of four pixels: a wall 4 m away, before which the first pixel shows a bulb."""
    width = np.full(8, 0.04, np.float32)
    width[0] = 0.02
    samples = scenes.samples_of(np.zeros((8, 3), np.float32), shapes=[(2, 4)], footprint=width)
    np.testing.assert_array_equal(beside_nearer(samples, 0), [0, 1, 0, 0, 1, 1, 0, 0])


def test_what_is_cut_is_told():
    sums = Sums(np.arange(2), MIXED)
    for value in (1.0, 1.0, 17.0):
        sums.add(Samples(np.arange(2), np.float32([[1.0] * 3, [value] * 3]), np.ones(2), *np.zeros((2, 2), bool)))
    sums.finish()
    assert sums.cut == pytest.approx(12 / 22)


def test_what_most_views_show_stays():
    assert summed([100.0, 90.0, 110.0]) == pytest.approx(100)  # a lamp
    assert summed([100.0, 90.0, 1.0]) == pytest.approx(191 / 3)
    assert summed([100.0]) == pytest.approx(100)


def test_highlights_stay():
    assert summed([1.0, 1.0, 4.5]) == pytest.approx(6.5 / 3)


def test_dark_surface_is_not_cut_below_what_the_room_has():
    """Something dark may be missing in the mesh, too."""
    assert summed([0.001, 1.0]) == pytest.approx(0.5005)


def test_views_count_by_what_they_show():
    assert summed([1.0, 100.0], weights=[1.0, 3.0]) == pytest.approx(301 / 4)
    assert summed([1.0, 100.0], weights=[1.0, MIXED]) == pytest.approx((1 + 5 * MIXED) / (1 + MIXED))


def test_clipped_pixels_of_a_lamp_are_cut_as_well():
    assert summed([1.0, 1.0, 100.0], clipped=[False, False, True]) == pytest.approx(7 / 3)
    assert summed([100.0, 90.0], clipped=[True, True]) == pytest.approx(100)  # a lamp: the highest bound


def test_clipped_pixels_do_not_tell_that_a_surface_is_dark():
    assert summed([2.0, 2.0, 100.0], clipped=[True, True, False]) == pytest.approx(100)
    assert summed([2.0, 2.0, 100.0], clipped=[True, True, True]) == pytest.approx(100)


def test_weights_that_the_sum_over_all_records_rounds_off():
    sums = Sums(np.arange(3), MIXED)
    for value in (1.0, 1.0, 100.0):
        radiance = np.float32([[50.0] * 3, [1.0] * 3, [value] * 3])
        sums.add(Samples(np.arange(3), radiance, np.array([1e6, 1e6, 1e-11]), *np.zeros((2, 3), bool)))
    sums.finish()
    np.testing.assert_allclose((sums.total / sums.weight[:, None])[:, 0], [50, 1, 7 / 3], rtol=1e-5)


def test_black_rooms_do_not_make_all_surface_black():
    sums = Sums(np.arange(3), MIXED)
    for value in (0.0, 0.0, 1.0):
        radiance = np.float32([[value] * 3, [0.0] * 3, [1.0] * 3])
        sums.add(Samples(np.arange(3), radiance, np.ones(3), *np.zeros((2, 3), bool)))
    sums.finish()
    np.testing.assert_allclose((sums.total / sums.weight[:, None])[:, 0], [1 / 3, 0, 1], rtol=1e-6)


@pytest.mark.parametrize("side", [0.005, 0.02, 0.08])
def test_memory_is_asked_for_as_many_records_as_a_view_shows(side):
    """A camera 1.5 m above a floor, along which it looks."""
    focal = 200
    column, row = (grid.ravel() for grid in np.meshgrid(np.arange(-80, 80) + 0.5, np.arange(40, 120) + 0.5))
    place = 1.5 / row[:, None] * np.column_stack([column, -row, np.full(row.shape, focal)])
    width = (1.5 / row * np.sqrt(1 + (column**2 + row**2) / focal**2)).astype(np.float32)
    samples = scenes.samples_of(place.astype(np.float32), footprint=width)
    shown = len(np.unique(np.floor(place / side).astype(int), axis=0))
    assert shown <= most_pairs([samples], side) <= 4 * shown


def test_samples_without_weight_show_nothing():
    sums = Sums(np.arange(2), MIXED)
    sums.add(Samples(np.array([0, 1]), np.ones((2, 3), np.float32), np.array([1.0, 0.0]), *np.zeros((2, 2), bool)))
    sums.finish()
    np.testing.assert_array_equal(sums.seen, [True, False])
    np.testing.assert_array_equal(sums.weight, [1, 0])


def test_a_room_that_no_pixel_shows():
    sums = Sums(np.arange(2), MIXED)
    sums.add(Samples(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0), *np.zeros((2, 0), bool)))
    sums.finish()
    assert not sums.weight.any()
