"""Blocks of pixels, and the cameras whose pixels they are."""

import numpy as np
import pytest

from fipt.conventions import FLAG_MOVED, FLAG_NOISE
from fipt.scene.blocks import block_flags, block_ids, block_mean, blocks
from fipt.scene.cameras import Camera


def test_what_fills_no_block_is_left_out():
    values = np.arange(5 * 7).reshape(5, 7)
    assert blocks(values, 2).shape == (2, 2, 3, 2)
    assert blocks(values, 2)[1, :, 2, :].tolist() == [[18, 19], [25, 26]]
    assert blocks(np.zeros((5, 7, 3)), 6).shape == (0, 6, 1, 6, 3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, bool])
def test_means(dtype):
    values = np.array([[1, 0, 1, 1, 9], [1, 1, 1, 1, 9]], dtype)
    assert block_mean(values, 2).tolist() == [[0.75, 1.0]]
    assert block_mean(values, 2).dtype == np.float32


def test_one_flag_is_the_blocks_but_noise_needs_most_of_it():
    flags = np.array([[FLAG_MOVED, FLAG_NOISE, FLAG_NOISE, FLAG_NOISE], [0, 0, FLAG_NOISE, 0]], np.uint32)
    assert block_flags(flags, 2).tolist() == [[FLAG_MOVED, FLAG_NOISE]]


def test_the_id_of_most_pixels_and_the_smallest_of_equals():
    assert block_ids(np.array([[5, 2, 7, 7], [2, 2, 3, 3]], np.uint16), 2).tolist() == [[2, 3]]


def test_a_point_is_in_the_block_of_its_pixel():
    camera = Camera("a", "train", 101, 62, 80.0, 75.0, 49.0, 33.0, np.eye(4))
    reduced = camera.reduced(4)
    assert (reduced.width, reduced.height) == (25, 15)
    points = np.array([[0.3, -0.2, -1.0], [-1.0, 0.5, -3.0]])
    assert reduced.project(points)[0] == pytest.approx(camera.project(points)[0] / 4)
