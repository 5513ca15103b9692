"""What the fit tells its networks of the views that teach them."""

import numpy as np

from fipt.conventions import SHADING_OUTPUTS
from fipt.model.networks import Field, SceneBox
from fipt.stages.fit.run import _learn_finest
from fipt.stages.fit.settings import FitSettings
from tests import scenes

PIXELS = 4
"""Of each of two views, all of one point."""


def test_pixels_without_weight_teach_nothing():
    """The second view is ten times nearer, and masked; the field before this one learned of it."""
    samples = scenes.samples_of(np.zeros((2 * PIXELS, 3)), views=("a", "b"), shapes=[(1, PIXELS)] * 2)
    samples.footprint[:] = np.repeat([0.01, 0.001], PIXELS)
    shading = np.ones((2 * PIXELS, SHADING_OUTPUTS, 3), np.float32)
    images = [(np.full((2 * PIXELS, 3), 0.5, np.float32), np.repeat([1.0, 0.0], PIXELS))]
    field = Field(FitSettings(table_log2=8, levels=2), SceneBox((0.0, 0.0, 0.0), 1.0))
    field.learn_finest(samples.position, np.full(2 * PIXELS, 0.0001, np.float32))
    _learn_finest(field, scenes.training_pixels([samples], [shading], images))
    np.testing.assert_allclose(field.finest_at(np.zeros((1, 3))), 0.01 * field.settings.footprint)
