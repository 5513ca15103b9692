"""The lens model, against OpenCV's."""

import cv2
import numpy as np
import pytest

from fipt.scene.lens import Lens

LENS = Lens(640, 480, 457.0, 460.0, 322.0, 237.0, (-0.11, 0.02, 1e-3, -8e-4, -0.003))


@pytest.fixture
def points(np_rng: np.random.Generator) -> np.ndarray:
    return np_rng.uniform((0, 0), (640, 480), (200, 2))


def test_distort_is_opencvs_projection_half_a_pixel_aside(points: np.ndarray) -> None:
    rays = np.column_stack([(points - (LENS.cx, LENS.cy)) / (LENS.fx, LENS.fy), np.ones(len(points))])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), LENS.matrix, np.array(LENS.distortion))
    assert np.abs(LENS.distort(points) - (expected[:, 0] + 0.5)).max() < 1e-9


def test_undistort_inverts_distort(points: np.ndarray) -> None:
    assert np.abs(LENS.undistort(LENS.distort(points)) - points).max() < 1e-9
    assert np.abs(LENS.pinhole.distort(points) - points).max() < 1e-9


def test_a_downscaled_lens_sees_the_same_field(points: np.ndarray) -> None:
    assert np.abs(LENS.downscaled(4).distort(points / 4) - LENS.distort(points) / 4).max() < 1e-9
    assert (LENS.downscaled(3).width, LENS.downscaled(7).height) == (213, 68)
