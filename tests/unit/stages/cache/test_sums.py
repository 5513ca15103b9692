"""Sums of records over views, and what one view alone shows."""

import numpy as np
import pytest

from fipt.stages.cache.sums import Sums

MIXED = 1e-3
ROOM = 100
"""Records of surface beside the one that is asked, of radiance 1."""


def summed(views, weights=None, clipped=None):
    """Mean radiance of record 0, of which each view shows one sample of a radiance."""
    sums = Sums(ROOM + 1, MIXED)
    for index, value in enumerate(views):
        radiance = np.ones((ROOM + 1, 3), np.float32)
        radiance[0] = value
        weight = np.ones(ROOM + 1)
        weight[0] = 1.0 if weights is None else weights[index]
        bound = np.zeros(ROOM + 1, bool)
        bound[0] = clipped is not None and clipped[index]
        sums.add(np.arange(ROOM + 1), radiance, weight, bound)
    sums.finish()
    mean = sums.total / sums.weight[:, None]
    np.testing.assert_allclose(mean[1:], 1.0)
    return mean[0, 0]


@pytest.mark.parametrize("dark", [0.5, 2.0])
def test_a_lamp_that_one_view_shows_behind_its_mesh_is_cut(dark):
    usual = max(dark, 1.0)  # the room's surface is as bright as 1
    assert summed([dark, dark, 100.0]) == pytest.approx((2 * dark + 5 * usual) / 3)
    assert summed([100.0, dark]) == pytest.approx((dark + 5 * usual) / 2)


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


def test_samples_without_weight_show_nothing():
    sums = Sums(2, MIXED)
    sums.add(np.array([0, 1]), np.ones((2, 3), np.float32), np.array([1.0, 0.0]), np.zeros(2, bool))
    sums.finish()
    np.testing.assert_array_equal(sums.seen, [True, False])
    np.testing.assert_array_equal(sums.weight, [1, 0])


def test_a_room_that_no_pixel_shows():
    sums = Sums(2, MIXED)
    sums.add(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0), np.zeros(0, bool))
    sums.finish()
    assert not sums.weight.any()
