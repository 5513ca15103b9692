"""Kinds of pixels of a room whose scan is compared with its true mesh."""

import numpy as np

from benchmarks.scan_errors import _KINDS, _Seen, kinds


def test_each_pixel_is_of_the_first_kind_that_it_meets():
    """A wall with two parts, a step, an emitter and a metal patch; the scan misses one pixel of it."""
    row, column = np.mgrid[:20, :40].astype(float)
    place = np.stack([column, row, np.where(column < 30, 0.0, 5.0)], axis=-1)
    wall = _Seen(place, np.tile([0.0, 0, 1], (20, 40, 1)), np.ones((20, 40)))
    scan = _Seen(place.copy(), wall.normal, wall.footprint)
    scan.place[2, 2, 2] += 2
    scan.place[4, 2] = np.nan
    ids = np.where(column < 20, 1, 2)
    emission = np.zeros((20, 40, 3))
    emission[10, 10] = 1
    metallic = np.zeros((20, 40))
    metallic[15:18, 2:5] = 1
    found = np.array(_KINDS)[kinds(wall, scan, ids, {"emission": emission, "metallic": metallic})]
    assert found[2, 2] == found[4, 2] == "off the surface"
    assert found[10, 12] == "beside an emitter"
    assert found[16, 3] == "metal"
    assert found[5, 29] == found[5, 30] == "beside a step"
    assert found[5, 19] == found[5, 20] == "beside a part"
    assert found[10, 13] == found[5, 5] == found[0, 39] == "inside"
