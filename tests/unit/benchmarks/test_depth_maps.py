"""Depth of a camera that is simulated: noise of the asked size, nothing at outlines."""

import numpy as np
import pytest

from benchmarks.depth_maps import sensed
from fipt.render.scene import RayScene
from tests import scenes
from tests.unit.stages.geometry.test_fusing import HALF, around


@pytest.mark.usefixtures("backend")
def test_a_depth_camera_is_as_noisy_as_asked():
    scene = RayScene(scenes.box((-HALF, -HALF, -HALF), (HALF, HALF, HALF)))
    view = around()[0]
    sensor_depth = sensed(scene, view.camera, 0.01, np.random.default_rng(0))
    assert sensor_depth.dtype == np.uint16
    known = sensor_depth > 0
    assert known.mean() > 0.9
    assert (sensor_depth[known] / 1000 - view.map.depth[known]).std() == pytest.approx(0.01, rel=0.1)
