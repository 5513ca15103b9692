"""What the photographs show of footprint samples."""

import numpy as np

from fipt.scene.observed import without_openings
from tests import scenes


def test_pixels_at_openings_tell_nothing_of_surface():
    """One view has a pixel without surface in its middle, another one that is covered in part in its corner."""
    counts, weight = np.ones(50, int), np.ones(50)
    counts[2 * 5 + 2] = 0
    weight[25] = 0.4
    samples = scenes.samples_of(np.zeros((49, 3)), 0, np.delete(weight, 12), counts, ("a", "b"), ((5, 5), (5, 5)))
    pixels = np.ones((50, 3), np.float32), np.full(50, 0.5, np.float32)
    (shard,) = scenes.observed([samples], [np.zeros((49, 15, 3), np.float32)], [pixels])
    left = without_openings([shard])[0].weight.reshape(2, 5, 5)
    first, second = np.full((5, 5), 0.5), np.full((5, 5), 0.5)
    first[1:4, 1:4] = 0
    second[:2, :2] = 0
    np.testing.assert_array_equal(left, [first, second])
    assert (shard.weight == 0.5).all()  # what was given stays
