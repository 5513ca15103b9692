"""The lens model is OpenCV's, half a pixel aside."""

import cv2
import numpy as np
import pytest

from fipt.scene.lens import Lens

LENS = Lens(640, 480, 457.0, 460.0, 322.0, 237.0, (-0.11, 0.02, 1e-3, -8e-4, -0.003))


def projected(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Pixels of (N, 3) rays, first centre at (0.5, 0.5)."""
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, np.array(lens.distortion))
    return seen[:, 0] + 0.5


def test_the_axis_meets_the_principal_point() -> None:
    assert projected(LENS, np.array([[0.0, 0.0, 1.0]]))[0] == pytest.approx((LENS.cx, LENS.cy))


def test_a_downscaled_lens_sees_the_same_field(np_rng: np.random.Generator) -> None:
    rays = np.column_stack([np_rng.uniform(-0.5, 0.5, (200, 2)), np.ones(200)])
    assert np.abs(projected(LENS.downscaled(4), rays) - projected(LENS, rays) / 4).max() < 1e-9
    assert (LENS.downscaled(3).width, LENS.downscaled(7).height) == (213, 68)
