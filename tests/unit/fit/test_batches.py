"""Training data: gathering over shards, pixels on edges, segments of hits, order of epochs."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.fit.batches import Pixels
from tests import scenes


def shards(rng, counts=((1, 2, 0, 3, 1), (2, 1, 1))):
    """Two shards; every hit's position and every pixel's radiance hold its number, so that mistakes show."""
    result, shading, images, start = [], [], [], 0
    for each in counts:
        n, pixels = sum(each), len(each)
        position = (100 * len(result) + np.arange(n))[:, None] * np.ones(3)
        weight = np.concatenate([rng.dirichlet(np.ones(c)) for c in each]) if n else []
        sub = (np.arange(4) / 8)[None, :, None] * np.ones((n, 4, 3))
        result.append(
            scenes.hits_of(
                position, np.arange(n) % 3, weight, each, footprint=np.float32(np.arange(n)), sub=sub.astype(np.float16)
            )
        )
        shading.append(rng.random((n, 13, 3)).astype(np.float16))
        images.append((np.arange(start, start + pixels)[:, None] * np.ones(3), np.ones(pixels, np.float32)))
        start += pixels
    return result, shading, images


def test_a_batch_holds_the_chosen_pixels_and_all_their_hits(np_rng):
    hits, shading, images = shards(np_rng)
    pixels = Pixels(hits, shading, images, None)
    assert len(pixels) == 7  # pixel 2 of the first shard sees nothing
    batch = pixels.batch(np.array([5, 0, 3, 2, 6]), 2, np_rng)
    radiance = batch.radiance[:, 0].numpy()
    assert sorted(radiance) == [0, 3, 4, 6, 7]
    hits_of_pixel = {0: [0], 1: [1, 2], 3: [3, 4, 5], 4: [6], 5: [100, 101], 6: [102], 7: [103]}
    owner = batch.owner.numpy()
    assert owner.max() == len(radiance) - 1
    for number, name in enumerate(radiance):
        own = owner == number
        expected = hits_of_pixel[int(name)]
        np.testing.assert_array_equal(np.floor(batch.points.numpy()[own, 0, 0]), expected)
        shard, local = (0, np.array(expected)) if name < 5 else (1, np.array(expected) - 100)
        np.testing.assert_array_equal(batch.shading.numpy()[own], shading[shard][local].astype(np.float32))
        np.testing.assert_array_equal(batch.footprint.numpy()[own], local)
        np.testing.assert_allclose(batch.weight.numpy()[own].sum(), 1, rtol=1e-6)
        np.testing.assert_allclose(batch.weight.numpy()[own], hits[shard].weight[local], rtol=1e-6)
    assert batch.segment.tolist() == [0] * len(owner)


def test_queries_are_stored_points_of_the_hit(np_rng):
    hits, shading, images = shards(np_rng)
    pixels = Pixels(hits, shading, images, None)
    for queries in (1, 2, 4):
        batch = pixels.batch(np.arange(7), queries, np_rng)
        share = (batch.points - batch.points.floor())[..., 0].numpy() * 8
        assert share.shape[1] == queries
        np.testing.assert_array_equal(share, np.round(share))
        assert all(len(set(row)) == queries for row in share)  # different ones
    picked = {int(p) for k in range(40) for p in (pixels.batch(np.array([0]), 1, np_rng).points[0, 0, :1] * 8)}
    assert picked == {0, 1, 2, 3}  # in turn all of them


def test_pixels_half_off_the_mesh_count_by_what_they_show(np_rng):
    hits = scenes.hits_of(np.zeros((3, 3)), weight=[0.25, 0.25, 0.75], counts=[2, 1])
    shading = [np.zeros((3, 13, 3), np.float16)]
    pixels = Pixels([hits], shading, [(np.ones((2, 3)), np.array([1.0, 0.5]))], None)
    batch = pixels.batch(np.array([0, 1]), 1, np_rng)
    np.testing.assert_allclose(batch.valid, [0.5, 0.375])
    np.testing.assert_allclose(batch.weight, [0.5, 0.5, 1.0])


def test_pixels_without_weight_are_left_out(np_rng):
    hits, shading, images = shards(np_rng)
    images[0][1][:] = 0
    images[1][1][1] = 0
    pixels = Pixels(hits, shading, images, None)
    assert sorted(pixels.batch(np.arange(len(pixels)), 1, np_rng).radiance[:, 0].tolist()) == [5, 7]


def test_every_epoch_visits_every_pixel_once(np_rng):
    pixels = Pixels(*shards(np_rng), None)
    orders = [pixels.epoch_order(epoch, seed) for seed in (0, 1) for epoch in (0, 1)]
    for order in orders:
        np.testing.assert_array_equal(np.sort(order), np.arange(7))
    assert len({tuple(order) for order in orders}) == 4
    np.testing.assert_array_equal(pixels.epoch_order(1, 0), orders[1])


def test_the_same_generator_draws_the_same_batch(np_rng):
    pixels = Pixels(*shards(np_rng), None)
    first, again, other = (pixels.batch(np.arange(7), 1, np.random.default_rng([0, 1, step])) for step in (4, 4, 5))
    np.testing.assert_array_equal(first.points, again.points)
    assert (first.points != other.points).any()


# --- segments -------------------------------------------------------------------------------------


def test_hits_take_the_segment_of_their_pixel_or_the_most_of_their_triangle(np_rng):
    """Also the largest id and the last triangle, which a histogram sized by either would lose."""
    #            pixel: 0  1  2  3  4  5
    counts = [1, 1, 1, 2, 2, 1]
    triangle = [4, 4, 4, 2, 4, 2, 9, 9]
    ids = np.array([7, 65535, 65535, 3, 0, 65535], np.uint16)
    hits = scenes.hits_of(np.zeros((8, 3)), triangle, 1.0, counts)
    hits.center[5] = 0  # the last pixel's centre sees nothing: its id belongs to no hit
    pixels = Pixels([hits], [np.zeros((8, 13, 3), np.float16)], [(np.ones((6, 3)), np.ones(6))], [ids])
    batch = pixels.batch(np.arange(6), 1, np_rng)
    order = np.argsort(batch.owner.numpy(), kind="stable")
    # beside the centre: triangle 4 has most votes for 65535; triangle 9 has none; the unknown pixel stays unknown
    np.testing.assert_array_equal(batch.segment.numpy()[order], [7, 65535, 65535, 3, 65535, 0, 0, 0])


def test_votes_are_counted_over_all_shards(np_rng):
    one = scenes.hits_of(np.zeros((3, 3)), [5, 5, 0], 1.0, [1, 2])
    two = scenes.hits_of(np.zeros((4, 3)), [5, 5, 5, 5], 1.0, [1, 1, 2])
    none = np.zeros((1, 13, 3), np.float16)
    pixels = Pixels(
        [one, two],
        [none.repeat(3, 0), none.repeat(4, 0)],
        [(np.zeros((2, 3)), np.ones(2)), (np.ones((3, 3)), np.ones(3))],
        [np.array([1, 1], np.uint16), np.array([2, 2, 2], np.uint16)],
    )
    assert pixels.segment[0].tolist() == [1, 1, 0]
    assert pixels.segment[1].tolist() == [2, 2, 2, 2]


def test_pictures_without_any_id(np_rng):
    hits, shading, images = shards(np_rng)
    empty = [np.zeros(5, np.uint16), np.zeros(3, np.uint16)]
    pixels = Pixels(hits, shading, images, empty)
    assert not pixels.batch(np.arange(7), 1, np_rng).segment.any()


# --- bad input ------------------------------------------------------------------------------------


def test_shading_of_another_shard_is_refused(np_rng):
    hits, shading, images = shards(np_rng)
    with pytest.raises(FiptError, match=r"shading must have shape \(7, 13, 3\); found \(4, 13, 3\)"):
        Pixels(hits, shading[::-1], images, None)


def test_without_any_pixel_there_is_nothing_to_fit(np_rng):
    hits, shading, images = shards(np_rng)
    with pytest.raises(FiptError, match="no training pixel shows the mesh"):
        Pixels(hits, shading, [(image, 0 * valid) for image, valid in images], None)


def test_clipped_pixels_are_marked_in_every_batch(np_rng):
    hits, shading, images = shards(np_rng)
    clipped = [np.array([True, False, False, False, True]), np.array([False, True, False])]
    batch = Pixels(hits, shading, images, None, clipped).batch(np.arange(7), 1, np_rng)
    marked = dict(zip(batch.radiance[:, 0].tolist(), batch.clipped.tolist(), strict=True))
    assert marked == {0: True, 1: False, 3: False, 4: True, 5: False, 6: True, 7: False}
    assert not Pixels(hits, shading, images, None).batch(np.arange(7), 1, np_rng).clipped.any()
