"""Training data: gathering over shards, pixels on edges, segments of samples, order of epochs."""

import numpy as np
import pytest
import torch

from fipt.conventions import SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.formats.arrays import on_disk
from fipt.stages.fit.batches import shuffled
from fipt.stages.fit.light_errors import LightErrors, cells_of
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
            scenes.samples_of(
                position, np.arange(n) % 3, weight, each, footprint=np.float32(np.arange(n)), sub=sub.astype(np.float16)
            )
        )
        shading.append(rng.random((n, SHADING_OUTPUTS, 3)).astype(np.float16))
        images.append((np.arange(start, start + pixels)[:, None] * np.ones(3), np.ones(pixels, np.float32)))
        start += pixels
    return result, shading, images


def test_a_batch_holds_the_chosen_pixels_and_all_their_samples(np_rng):
    samples, shading, images = shards(np_rng)
    pixels = scenes.training_pixels(samples, shading, images, None)
    assert len(pixels) == 7  # pixel 2 of the first shard sees nothing
    batch = pixels.batch(np.array([5, 0, 3, 2, 6]), 2, np_rng)
    radiance = batch.radiance[:, 0].numpy()
    assert sorted(radiance) == [0, 3, 4, 6, 7]
    samples_of_pixel = {0: [0], 1: [1, 2], 3: [3, 4, 5], 4: [6], 5: [100, 101], 6: [102], 7: [103]}
    owner = batch.owner.numpy()
    assert owner.max() == len(radiance) - 1
    for number, name in enumerate(radiance):
        own = owner == number
        expected = samples_of_pixel[int(name)]
        np.testing.assert_array_equal(np.floor(batch.points.numpy()[own, 0, 0]), expected)
        shard, local = (0, np.array(expected)) if name < 5 else (1, np.array(expected) - 100)
        np.testing.assert_array_equal(batch.shading.numpy()[own], shading[shard][local].astype(np.float32))
        np.testing.assert_array_equal(batch.footprint.numpy()[own], local)
        np.testing.assert_allclose(batch.weight.numpy()[own].sum(), 1, rtol=1e-6)
        np.testing.assert_allclose(batch.weight.numpy()[own], samples[shard].weight[local], rtol=1e-6)
    assert batch.segment.tolist() == [0] * len(owner)


def test_a_batch_is_without_the_known_errors_of_the_light(np_rng):
    pixels = scenes.training_pixels(*shards(np_rng), None)
    before = pixels.batch(np.arange(7), 2, np.random.default_rng(1))
    center, side = np.array([50.0, 0, 0]), 200.0
    key, _ = cells_of(before.points[:, 0].numpy(), np.zeros(len(before.points), int), center, side)
    pixels.light = LightErrors(center, side, key, np.full(len(key), np.log(2)))
    after = pixels.batch(np.arange(7), 2, np.random.default_rng(1))
    np.testing.assert_allclose(after.shading, 2 * before.shading, rtol=1e-6)
    np.testing.assert_array_equal(after.radiance, before.radiance)


def test_all_of_a_batch_goes_to_a_device(np_rng):
    pixels = scenes.training_pixels(*shards(np_rng), None)
    there = pixels.batch(np.array([5, 0]), 2, np_rng).to(torch.device("meta"))
    assert {values.device.type for values in vars(there).values() if values is not None} == {"meta"}
    assert there.beyond is None


def test_queries_are_stored_points_of_the_sample(np_rng):
    samples, shading, images = shards(np_rng)
    pixels = scenes.training_pixels(samples, shading, images, None)
    for queries in (1, 2, 4):
        batch = pixels.batch(np.arange(7), queries, np_rng)
        share = (batch.points - batch.points.floor())[..., 0].numpy() * 8
        assert share.shape[1] == queries
        np.testing.assert_array_equal(share, np.round(share))
        assert all(len(set(row)) == queries for row in share)  # different ones
    picked = {int(p) for k in range(40) for p in (pixels.batch(np.array([0]), 1, np_rng).points[0, 0, :1] * 8)}
    assert picked == {0, 1, 2, 3}  # in turn all of them


def test_queries_lie_below_the_surface(np_rng):
    samples, shading, images = shards(np_rng)
    pixels = scenes.training_pixels(samples, shading, images, None)
    for number, each in enumerate(samples):
        each.normal[:] = np.arange(len(each.normal))[:, None] + [0.25, 10 * number, 0.5]  # of its own
    on = pixels.batch(np.arange(7), 2, np.random.default_rng(0))
    pixels.inset = 0.25
    below = pixels.batch(np.arange(7), 2, np.random.default_rng(0))
    sample = on.points[:, 0].floor()[:, 0].numpy()  # its position holds its number, and that of its shard
    number, shard = sample % 100, sample // 100
    normals = number[:, None] + np.stack([0 * shard + 0.25, 10 * shard, 0 * shard + 0.5], axis=1)
    np.testing.assert_allclose(on.points - below.points, np.repeat(0.25 * normals[:, None], 2, axis=1), atol=1e-4)


def test_pixels_half_off_the_mesh_count_by_what_they_show(np_rng):
    samples = scenes.samples_of(np.zeros((3, 3)), weight=[0.25, 0.25, 0.75], counts=[2, 1])
    shading = [np.zeros((3, SHADING_OUTPUTS, 3), np.float16)]
    pixels = scenes.training_pixels([samples], shading, [(np.ones((2, 3)), np.array([1.0, 0.5]))], None)
    batch = pixels.batch(np.array([0, 1]), 1, np_rng)
    np.testing.assert_allclose(batch.valid, [0.5, 0.375])
    np.testing.assert_allclose(batch.weight, [0.5, 0.5, 1.0])


def test_pixels_without_weight_are_left_out(np_rng):
    samples, shading, images = shards(np_rng)
    images[0][1][:] = 0
    images[1][1][1] = 0
    pixels = scenes.training_pixels(samples, shading, images, None)
    assert sorted(pixels.batch(np.arange(len(pixels)), 1, np_rng).radiance[:, 0].tolist()) == [5, 7]


def test_every_epoch_visits_every_pixel_once(np_rng):
    pixels = scenes.training_pixels(*shards(np_rng), None)
    orders = [shuffled(np.arange(7), len(pixels), [seed, epoch]) for seed in (0, 1) for epoch in (0, 1)]
    for order in orders:
        np.testing.assert_array_equal(np.sort(order), np.arange(7))
    assert len({tuple(order) for order in orders}) == 4
    np.testing.assert_array_equal(shuffled(np.array([3, 5]), 7, [0, 1]), orders[1][[3, 5]])


@pytest.mark.parametrize("count", [1, 2, 3, 16, 17, 1000, 4097])
def test_a_shuffled_deck_holds_every_card_once(count):
    np.testing.assert_array_equal(np.sort(shuffled(np.arange(count), count, [0, 0])), np.arange(count))


def test_a_shuffled_deck_is_random():
    """Every card comes to every place equally often, and neighbours do not stay together."""
    decks = np.array([shuffled(np.arange(20), 20, [0, epoch]) for epoch in range(2000)])
    for place in (0, 7, 19):
        counts = np.bincount(decks[:, place], minlength=20)
        assert ((counts - 100) ** 2 / 100).sum() < 44  # chi square, 19 degrees of freedom: 1 in 1000 exceeds it
    large = shuffled(np.arange(4000), 40_000_000, [5, 0])
    assert abs(np.corrcoef(large, np.arange(4000))[0, 1]) < 0.06
    assert abs(np.corrcoef(large[1:], large[:-1])[0, 1]) < 0.06
    assert abs(large.mean() / 40e6 - 0.5) < 0.02


def test_the_same_generator_draws_the_same_batch(np_rng):
    pixels = scenes.training_pixels(*shards(np_rng), None)
    first, again, other = (pixels.batch(np.arange(7), 1, np.random.default_rng([0, 1, step])) for step in (4, 4, 5))
    np.testing.assert_array_equal(first.points, again.points)
    assert (first.points != other.points).any()


def test_batches_do_not_depend_on_shards_nor_on_where_arrays_lie(np_rng, tmp_path):
    """Three views in one shard, in memory; and each in a shard of its own, on disk."""
    counts = [[1, 2, 0, 3], [2, 1, 1, 1], [0, 1, 1, 4]]
    flat = np.concatenate(counts)
    n, triangle = int(flat.sum()), np_rng.integers(0, 4, int(flat.sum()))
    arrays = {
        "position": np_rng.random((n, 3)),
        "triangle": triangle,
        "weight": np_rng.uniform(0.1, 0.3, n),
        "sub": np_rng.random((n, 4, 3)).astype(np.float16),
    }
    shading, images = (
        np_rng.random((n, SHADING_OUTPUTS, 3)).astype(np.float32),
        np_rng.random((12, 3)).astype(np.float32),
    )
    ids, ones = np_rng.integers(0, 3, 12).astype(np.uint16), np.ones(12, np.float32)
    whole = scenes.samples_of(**arrays, counts=flat, views="abc", shapes=[(2, 2)] * 3)
    ends = np.cumsum([sum(c) for c in counts])
    cuts = [slice(end - sum(c), end) for end, c in zip(ends, counts, strict=True)]
    views = [slice(4 * k, 4 * k + 4) for k in range(3)]
    single = [
        scenes.samples_of(**{name: array[cut] for name, array in arrays.items()}, counts=c, views=v, shapes=[(2, 2)])
        for cut, c, v in zip(cuts, counts, "abc", strict=True)
    ]
    one = scenes.training_pixels([whole], [shading], [(images, ones)], [ids])
    many = scenes.training_pixels(
        single,
        [shading[cut] for cut in cuts],
        [(images[v], ones[v]) for v in views],
        [ids[v] for v in views],
        empty=on_disk(tmp_path),
    )
    assert len(one) == len(many) == 10
    assert one.largest_segment == many.largest_segment
    chosen = np_rng.permutation(10)[:7]
    batches = [pixels.batch(chosen, 2, np.random.default_rng(5)) for pixels in (one, many)]
    for name, values in vars(batches[0]).items():
        np.testing.assert_array_equal(values, getattr(batches[1], name), err_msg=name)


# --- segments -------------------------------------------------------------------------------------


def test_samples_take_the_segment_of_their_pixel_or_the_most_of_their_triangle(np_rng):
    """Also the largest id and the last triangle, which a histogram sized by either would lose."""
    #            pixel: 0  1  2  3  4  5
    counts = [1, 1, 1, 2, 2, 1]
    triangle = [4, 4, 4, 2, 4, 2, 9, 9]
    ids = np.array([7, 65535, 65535, 3, 0, 65535], np.uint16)
    samples = scenes.samples_of(np.arange(24), triangle, 1.0, counts)  # far from each other
    samples.center[5] = 0  # the last pixel's centre sees nothing: its id belongs to no hit
    pixels = scenes.training_pixels(
        [samples], [np.zeros((8, SHADING_OUTPUTS, 3), np.float16)], [(np.ones((6, 3)), np.ones(6))], [ids]
    )
    batch = pixels.batch(np.arange(6), 1, np_rng)
    order = np.argsort(batch.owner.numpy(), kind="stable")
    # beside the centre: triangle 4 has most votes for 65535; triangle 9 has none; the unknown pixel stays unknown
    np.testing.assert_array_equal(batch.segment.numpy()[order], [7, 65535, 65535, 3, 65535, 0, 0, 0])


def test_votes_are_counted_over_all_shards(np_rng):
    one = scenes.samples_of(np.arange(9), [5, 5, 0], 1.0, [1, 2])
    two = scenes.samples_of(np.arange(12), [5, 5, 5, 5], 1.0, [1, 1, 2])
    none = np.zeros((1, SHADING_OUTPUTS, 3), np.float16)
    pixels = scenes.training_pixels(
        [one, two],
        [none.repeat(3, 0), none.repeat(4, 0)],
        [(np.zeros((2, 3)), np.ones(2)), (np.ones((3, 3)), np.ones(3))],
        [np.array([1, 1], np.uint16), np.array([2, 2, 2], np.uint16)],
    )
    shard, pixel, sample = np.repeat([0, 1], [3, 4]), np.array([0, 1, 1, 0, 1, 2, 2]), np.array([0, 1, 2, 0, 1, 2, 3])
    assert pixels.segment_of(shard, pixel, sample).tolist() == [1, 1, 0, 2, 2, 2, 2]
    assert pixels.largest_segment == 2


def test_images_without_any_id(np_rng):
    samples, shading, images = shards(np_rng)
    empty = [np.zeros(5, np.uint16), np.zeros(3, np.uint16)]
    pixels = scenes.training_pixels(samples, shading, images, empty)
    assert not pixels.batch(np.arange(7), 1, np_rng).segment.any()


# --- bad input ------------------------------------------------------------------------------------


def test_shading_of_another_shard_is_refused(np_rng):
    samples, shading, images = shards(np_rng)
    with pytest.raises(
        FiptError, match=rf"shading must have shape \(7, {SHADING_OUTPUTS}, 3\); found \(4, {SHADING_OUTPUTS}, 3\)"
    ):
        scenes.training_pixels(samples, shading[::-1], images, None)


def test_without_any_pixel_there_is_nothing_to_fit(np_rng):
    samples, shading, images = shards(np_rng)
    with pytest.raises(FiptError, match="no training pixel shows the mesh"):
        scenes.training_pixels(samples, shading, [(image, 0 * valid) for image, valid in images], None)


def test_pixels_at_the_edge_of_an_opening_keep_their_shares(np_rng):
    """What is known to lie beyond is no part of the mesh; other pixels off the mesh are scaled up as ever."""
    samples, shading, images = shards(np_rng)
    for shard in samples:
        shard.weight[:] *= 0.75
    beyond = [(np.array([0, 3]), np.float32([[1, 2, 0], [0.5, 0, 0]])), (np.empty(0, np.int64), np.empty((0, 3)))]
    pixels = scenes.training_pixels(samples, shading, images, None, beyond=beyond)
    batch = pixels.batch(np.array([5, 0, 3, 2, 6]), 2, np_rng)
    number = batch.radiance[:, 0].numpy()
    total = np.bincount(batch.owner.numpy(), batch.weight.numpy())
    at_edge = (number == 0) | (number == 3)
    assert at_edge.sum() == 2
    np.testing.assert_allclose(total, np.where(at_edge, 0.75, 1), rtol=1e-6)
    np.testing.assert_allclose(batch.share.numpy(), np.where(at_edge, 0.75, 1), rtol=1e-6)
    np.testing.assert_allclose(batch.beyond.numpy()[number == 3], [[0.5, 0, 0]])
    np.testing.assert_allclose(batch.on_mesh.numpy()[number == 3], [[2.5 / 0.75, 4, 4]])
    np.testing.assert_array_equal(batch.on_mesh.numpy()[number == 0], 0)  # the outside is brighter than the pixel
    np.testing.assert_array_equal(batch.beyond.numpy()[~at_edge], 0)


def test_without_openings_nothing_is_beyond(np_rng):
    samples, shading, images = shards(np_rng)
    nothing = [(np.empty(0, np.int64), np.empty((0, 3), np.float32))] * 2
    first, second = (
        scenes.training_pixels(samples, shading, images, None, beyond=beyond).batch(
            np.arange(7), 2, np.random.default_rng(1)
        )
        for beyond in (None, nothing)
    )
    assert first.beyond is None
    assert second.beyond is None
    assert first.on_mesh is first.radiance
    np.testing.assert_array_equal(first.weight, second.weight)


def test_clipped_pixels_are_marked_in_every_batch(np_rng):
    samples, shading, images = shards(np_rng)
    clipped = [np.array([True, False, False, False, True]), np.array([False, True, False])]
    batch = scenes.training_pixels(samples, shading, images, None, clipped=clipped).batch(np.arange(7), 1, np_rng)
    marked = dict(zip(batch.radiance[:, 0].tolist(), batch.clipped.tolist(), strict=True))
    assert marked == {0: True, 1: False, 3: False, 4: True, 5: False, 6: True, 7: False}
    assert not scenes.training_pixels(samples, shading, images, None).batch(np.arange(7), 1, np_rng).clipped.any()
