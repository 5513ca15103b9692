"""Fragments of one emitter: panes behind bars, speckles that touch, and what stays apart."""

import numpy as np
import pytest

from fipt.stages.emitters.fragments import same_emitters
from tests import scenes

PIXEL = 0.01


def panes(*places, size=0.4, depth=0.0, rng=None, noise=0.0):
    """Square panes at (x, y) in the plane z = 0, each of 200 triangles; emitter of each triangle."""
    sheets = [scenes.sheet((x, y, depth), (size, 0, 0), (0, size, 0), 10) for x, y in places]
    mesh = scenes.joined(*sheets)
    if noise:
        mesh.vertices[:, 2] += rng.normal(0, noise, len(mesh.vertices)).astype(np.float32)
    count = len(sheets[0].triangles)
    return mesh, np.repeat(np.arange(len(places)), count)


def pairs(mesh, emitter, level=None, error=0.01):
    count = int(emitter.max()) + 1
    level = np.full((count, 3), 5.0) if level is None else np.asarray(level, float)[:, None] * np.ones(3)
    found = same_emitters(mesh, np.arange(len(emitter)), emitter, level, np.full((count, 3), error), PIXEL)
    return {tuple(pair) for pair in found.T.tolist()}


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_panes_behind_bars_are_one_emitter(np_rng, noise):
    mesh, emitter = panes((0, 0), (0.46, 0), (0, 0.46), (0.46, 0.46), rng=np_rng, noise=noise)
    assert {(0, 1), (0, 2), (1, 3), (2, 3)} <= pairs(mesh, emitter)


def test_two_windows_in_a_wall_are_two():
    assert pairs(*panes((0, 0), (0.7, 0))) == set()


def test_panes_of_other_radiance_are_two_unless_the_difference_is_not_known():
    mesh, emitter = panes((0, 0), (0.46, 0))
    assert pairs(mesh, emitter, [5.0, 6.0]) == set()
    assert pairs(mesh, emitter, [5.0, 6.0], error=0.5) == {(0, 1)}


def test_panes_in_two_planes_are_two():
    first, emitter = panes((0, 0))
    second, _ = panes((0.46, 0), depth=0.05)
    mesh = scenes.joined(first, second)
    assert pairs(mesh, np.concatenate([emitter, emitter + 1])) == set()


def test_fragments_that_touch_in_a_picture_are_one_in_whatever_plane():
    first, emitter = panes((0, 0))
    side = scenes.sheet((0.415, 0, 0), (0, 0, 0.4), (0, 0.4, 0), 10)
    mesh = scenes.joined(first, side)
    assert pairs(mesh, np.concatenate([emitter, emitter + 1])) == {(0, 1)}


def test_a_long_thin_lamp_reaches_no_farther_than_it_is_thin():
    tubes = [scenes.sheet((0, y, 0), (1.2, 0, 0), (0, 0.05, 0), 10) for y in (0, 0.12)]
    mesh = scenes.joined(*tubes)
    assert pairs(mesh, np.repeat([0, 1], len(tubes[0].triangles))) == set()


def test_one_emitter_has_no_pair():
    assert pairs(*panes((0, 0))) == set()
