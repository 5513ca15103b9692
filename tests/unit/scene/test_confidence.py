"""Confidence: predicted errors by voxel and facing, on disk and at points."""

import numpy as np
import pytest

from fipt.scene.confidence import Confidence, confidence_of, read_confidence, write_confidence

UP = np.array([[0.0, 1, 0]])
UNSEEN = np.float32([0.25, 0.5, 0.125])


@pytest.fixture
def one_voxel():
    """A box of one voxel, of which the surface that faces up (record 3) is known, and that facing down is not."""
    errors = np.float32([0.1, 0.05]), np.float32([0.2, 0.3]), np.float32([0.01, 0.02])
    return Confidence(np.zeros(3), 2.0, 1, np.array([2, 3]), *errors, np.array([False, True]), UNSEEN)


def test_confidence_is_the_error_of_kd_in_decibels():
    errors = 10 ** (-np.array([5.0, 10, 15, 22.5, 35, 50]) / 20)
    np.testing.assert_allclose(confidence_of(errors), [0, 0, 0.2, 0.5, 1, 1], atol=1e-12)
    assert confidence_of(np.zeros(1)) == 1


def test_layers_at_points(one_voxel, tmp_path):
    write_confidence(tmp_path / "confidence.npz", one_voxel)
    found = read_confidence(tmp_path / "confidence.npz")
    point = np.array([[0.3, 0.0, -0.5]])
    up, down, side = (found.layers(point, normal) for normal in (UP, -UP, UP[:, [1, 0, 2]]))
    assert up["confidence"] == pytest.approx(confidence_of(np.array([0.05])))
    assert [up[f"{name}_error"][0] for name in ("kd", "roughness", "metallic")] == pytest.approx([0.05, 0.3, 0.02])
    assert down["confidence"] == 0  # seen, but nothing tells of it
    assert down["kd_error"] == pytest.approx(0.1)
    assert side["confidence"] == 0
    assert [side[f"{name}_error"][0] for name in ("kd", "roughness", "metallic")] == pytest.approx(UNSEEN)
