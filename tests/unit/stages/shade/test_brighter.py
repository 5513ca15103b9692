"""Light that is missing shows as surface that is brighter than white."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.shading import Shading
from fipt.stages.shade.brighter import more_brighter
from tests import scenes

PIXELS = 200


@pytest.mark.parametrize("usual", [1.0, 0.5])
@pytest.mark.parametrize(("light", "expected"), [(0.2, 1.0), (0.7, 0.0), (1.3, 0.0)])
def test_missing_light_is_told_by_surface_brighter_than_white(np_rng, light, expected, usual):
    """A grey room of albedo 0.5 under a light of 1, of which a round finds a share; all pixels have one weight."""
    samples = scenes.samples_of(np_rng.random((PIXELS, 3)))
    pixels = np.full((PIXELS, 3), 0.5, np.float32), np.full(PIXELS, usual), np.zeros(PIXELS, bool)
    old, new = (Shading.of(np.full((PIXELS, SHADING_OUTPUTS, 3), value, np.float32)) for value in (1.0, light))
    assert more_brighter(samples, 0, (new, old), pixels, np.array([5])) == (expected, PIXELS)
    assert more_brighter(samples, 0, (new, new), pixels, np.array([5])) == (0, PIXELS)
    assert more_brighter(samples, 0, (new, old), pixels, np.array([0])) == (0, 0)  # all that is seen emits
