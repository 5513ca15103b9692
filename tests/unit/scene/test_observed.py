"""What the photographs show of footprint samples."""

import numpy as np

from fipt.scene.observed import full_pixels, fully_weighted, without_openings, without_triangles
from tests import scenes


def seen(samples, weight):
    """A shard of these samples, whose (P,) pixels have this weight."""
    pixels = np.ones((len(weight), 3), np.float32), np.asarray(weight, np.float32)
    (shard,) = scenes.observed([samples], [np.zeros((len(samples.position), 15, 3), np.float32)], [pixels])
    return shard


def test_the_rim_of_a_mask_has_less_than_the_usual_weight():
    np.testing.assert_array_equal(fully_weighted(np.array([0.9, 0.9, 0.4, 0.9, 0])), [True, True, False, True, False])
    assert not fully_weighted(np.zeros(3)).any()


def test_a_view_is_judged_by_its_own_weights():
    """Whatever other views are in its shard."""
    weight = np.r_[np.ones(8), np.full(4, 0.5)]
    samples = scenes.samples_of(np.zeros((12, 3)), 0, views=("a", "b"), shapes=((2, 4), (2, 2)))
    assert full_pixels(samples, weight).all()
    assert not fully_weighted(weight).all()


def test_pixels_at_openings_tell_nothing_of_surface():
    """One view has a pixel without surface in its middle, another one that is covered in part in its corner."""
    counts, weight = np.ones(50, int), np.ones(50)
    counts[2 * 5 + 2] = 0
    weight[25] = 0.4
    samples = scenes.samples_of(np.zeros((49, 3)), 0, np.delete(weight, 12), counts, ("a", "b"), ((5, 5), (5, 5)))
    shard = seen(samples, np.full(50, 0.5))
    left = without_openings([shard])[0].weight.reshape(2, 5, 5)
    first, second = np.full((5, 5), 0.5), np.full((5, 5), 0.5)
    first[1:4, 1:4] = 0
    second[:2, :2] = 0
    np.testing.assert_array_equal(left, [first, second])
    assert (shard.weight == 0.5).all()  # what was given stays


def test_pixels_that_show_an_emitter_tell_nothing_nor_do_those_around():
    """Triangle 3 is a second piece in a pixel of the last row; triangle 9, above all that are named, is not meant."""
    counts, triangle = np.ones(25, int), np.zeros(26, int)
    counts[22] = 2
    triangle[23], triangle[0] = 3, 9
    shard = seen(scenes.samples_of(np.zeros((26, 3)), triangle, 0.5, counts, shapes=((5, 5),)), np.ones(25))
    expected = np.ones((5, 5))
    expected[4, 2] = 0
    left = without_triangles([shard], np.array([3, 4]))[0].weight.reshape(5, 5)
    np.testing.assert_array_equal(left, expected)
    expected[3:, 1:4] = 0
    left = without_triangles([shard], np.array([3, 4]), around=True)[0].weight.reshape(5, 5)
    np.testing.assert_array_equal(left, expected)
    assert (without_triangles([shard], np.zeros(0, int))[0].weight == 1).all()
