"""Boards in pictures: corners of a far board, seen through a known homography and averaged over pixels."""

import cv2
import numpy as np
import pytest

from fipt.scene.boards import board_corners, charuco_board, charuco_corners, dictionary

SUB = 6  # rays along a pixel


@pytest.fixture(scope="module")
def far_board():
    """Board of 15 pixels a square, turned and tilted, blurred as by a lens: picture, board, its true corners."""
    board = charuco_board((5, 4), 0.12, 0.09, dictionary("DICT_5X5_100", "here"))
    side = 56  # fields of the markers are whole texels
    pattern = board.generateImage((7 * side, 6 * side), marginSize=side // 2, borderBits=1).astype(np.float32)
    width, height = 200, 160
    warp = np.array([[15.0, 2.0, 50.3], [-1.5, 14.0, 38.6], [0.004, 0.006, 1.0]])  # squares -> image coordinates
    row, column = (np.indices((height * SUB, width * SUB)) + 0.5) / SUB
    place = np.stack([column, row, np.ones_like(row)], -1) @ np.linalg.inv(warp).T
    place = place[..., :2] / place[..., 2:]
    texel = np.float32((place + 0.5) * side - 0.5)
    fine = cv2.remap(pattern, texel[..., 0], texel[..., 1], cv2.INTER_LINEAR, borderValue=180)
    fine = cv2.GaussianBlur(fine, (0, 0), 0.5 * SUB)
    picture = fine.reshape(height, SUB, width, SUB).mean(axis=(1, 3))
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    flat = np.array(board.getChessboardCorners())[:, :2] / 0.12
    true = cv2.perspectiveTransform(flat[:, None].astype(np.float64), warp)[:, 0]
    return np.uint8(np.clip(20 + 0.8 * picture + noise, 0, 255)), board, true


def errors(pixels, ids, true):
    return np.linalg.norm(pixels - true[ids], axis=1)


def test_the_whole_pattern_tells_every_corner_of_a_far_board(far_board):
    picture, board, true = far_board
    large = cv2.resize(picture, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    _, pixels, ids = charuco_corners(large, board, 4, beside=1)
    pixels = pixels.astype(np.float64) / 4
    matched, every, match = board_corners(picture, board, pixels, ids)
    assert every.tolist() == list(range(20))
    assert match > 0.9
    own = errors(matched, every, true)
    assert own.max() < 0.05
    assert own.mean() < 0.5 * errors(pixels, ids, true).mean()
    # no shrinking: the mean distance of neighbours is that of the true corners
    span = np.linalg.norm(matched[4] - matched[15]) / np.linalg.norm(true[4] - true[15])
    assert span == pytest.approx(1, abs=6e-4)


def test_corners_outside_of_the_picture_are_not_told(far_board):
    picture, board, true = far_board
    cut = np.ascontiguousarray(picture[:, :100])
    inside = np.flatnonzero(true[:, 0] < 100)
    assert 0 < len(inside) < 20
    matched, ids, _ = board_corners(cut, board, true[inside], inside)
    assert ids.tolist() == inside.tolist()
    assert errors(matched, ids, true).max() < 0.15


def test_something_else_is_no_board(far_board):
    picture, board, true = far_board
    noise = np.random.default_rng(1).integers(0, 255, picture.shape, np.uint8)
    assert board_corners(noise, board, true, np.arange(20)) is None
    assert board_corners(picture, board, true[::-1], np.arange(20)) is None
