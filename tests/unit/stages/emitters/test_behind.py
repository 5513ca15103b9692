"""A window behind slats: most of its triangles fill no pixel, and their radiance is told by a line."""

import numpy as np
import pytest

from fipt.stages.emitters.behind import grown
from fipt.stages.emitters.observations import share_above_white
from fipt.stages.emitters.regions import Surface
from tests import scenes

WINDOW = np.array([6.0, 6.5, 7.0], np.float32)
SLAT = np.array([1.0, 0.9, 0.8], np.float32)
CELLS = 4
"""Squares of the sheet in a row, half a metre each, two triangles a square."""


def sheet():
    quads = [scenes.quad((0.5 * k, 0, 0), (0.5, 0, 0), (0, 0.5, 0)) for k in range(CELLS)]
    return scenes.joined(*quads)


def surface(mesh, region):
    """What views show: region 0 emits, of enough pixels; of the rest next to none is told."""
    count = len(mesh.triangles)
    radiance, pixels = np.full((count, 3), np.nan), np.zeros(count, np.int64)
    radiance[region == 0], pixels[region == 0] = WINDOW, 30
    width = np.where(region == 0, 0.02, 0.0)
    return Surface(radiance, pixels, width, np.zeros(count, int), region, np.empty((2, 0), int), 0.01)


def shards(rng, mesh, own, pixels=120, noise=0.05):
    """Pixels that show a share of a triangle (radiance (T, 3)) and a slat before it, in two views."""
    count = len(mesh.triangles)
    triangle = np.tile(np.repeat(np.arange(count), pixels), 2)
    w = rng.uniform(0.1, 0.8, len(triangle))[:, None]
    image = (w * own[triangle] + (1 - w) * SLAT) * np.exp(noise * rng.standard_normal((len(w), 1)))
    place = mesh.corners[triangle].mean(axis=1)
    samples = scenes.samples_of(place, triangle, w[:, 0], views=("a", "b"), shapes=[(1, count * pixels)] * 2)
    shading = np.zeros((len(w), 16, 3), np.float32)
    shading[:, 0] = 1.2
    return scenes.observed([samples], [shading], [(image.astype(np.float32), np.ones(len(w), np.float32))])


@pytest.fixture
def mesh():
    return sheet()


@pytest.fixture
def start(mesh):
    """The first square is known to emit."""
    region = np.full(len(mesh.triangles), -1)
    region[:2] = 0
    return region


def test_the_emitter_grows_over_what_the_lines_tell(np_rng, mesh, start):
    own = np.tile(WINDOW, (len(mesh.triangles), 1))
    label, seen = grown(mesh, surface(mesh, start), shards(np_rng, mesh, own), start)
    np.testing.assert_array_equal(label, 0)
    np.testing.assert_array_equal(np.unique(seen.triangle), np.arange(2, 2 * CELLS))
    np.testing.assert_allclose(np.median(seen.radiance, axis=0), WINDOW, rtol=0.02)


def test_it_ends_at_what_is_dark_behind_the_slats(np_rng, mesh, start):
    own = np.tile(WINDOW, (len(mesh.triangles), 1))
    own[4:] = 0.5
    label, _ = grown(mesh, surface(mesh, start), shards(np_rng, mesh, own), start)
    np.testing.assert_array_equal(np.flatnonzero(label == 0), [0, 1, 2, 3])


def test_few_pixels_tell_no_line(np_rng, mesh, start):
    own = np.tile(WINDOW, (len(mesh.triangles), 1))
    label, seen = grown(mesh, surface(mesh, start), shards(np_rng, mesh, own, pixels=4), start)
    np.testing.assert_array_equal(label, start)
    assert len(seen.triangle) == 0


def test_what_pixels_tell_by_themselves_is_left_to_them(np_rng, mesh, start):
    own = np.tile(WINDOW, (len(mesh.triangles), 1))
    known = surface(mesh, start)
    known.pixels[:] = 30
    label, _ = grown(mesh, known, shards(np_rng, mesh, own), start)
    np.testing.assert_array_equal(label, start)


def test_without_an_emitter_nothing_grows(np_rng, mesh, start):
    none = np.full_like(start, -1)
    label, seen = grown(mesh, surface(mesh, none), shards(np_rng, mesh, np.ones((2 * CELLS, 3)) * WINDOW), none)
    np.testing.assert_array_equal(label, none)
    assert len(seen.triangle) == 0


def test_the_share_of_pixels_above_white_leaves_emitters_out(np_rng, mesh):
    (shard,) = shards(np_rng, mesh, np.tile(SLAT, (len(mesh.triangles), 1)))
    shard.samples.weight[:] = 1
    shard.radiance[:] = 0.5
    bright = np.isin(shard.samples.triangle, [0, 1])
    shard.radiance[bright] = 2.0
    assert share_above_white([shard], np.empty(0, int)) == pytest.approx(0.25)
    assert share_above_white([shard], np.array([0, 1])) == 0
