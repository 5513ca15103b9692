"""Directions about normals: what share of them goes where, and how evenly they are spread."""

import numpy as np
import pytest

from fipt.render.directions import cosine_directions, even_cosine_directions

NORMAL = np.array([0.6, 0.0, 0.8])


def even(count, rng):
    """As many directions of one sequence about `NORMAL`."""
    return even_cosine_directions(np.tile(NORMAL, (count, 1)), np.arange(count), rng.random((1, 2)))


def random(count, rng):
    """As many random ones."""
    return cosine_directions(np.tile(NORMAL, (count, 1)), rng)


@pytest.mark.parametrize("drawn", [even, random])
def test_directions_are_distributed_as_the_cosine(np_rng, drawn):
    direction = drawn(20_000, np_rng)
    assert direction.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, rtol=1e-5)
    cos = direction @ NORMAL
    assert (cos > 0).all()
    np.testing.assert_allclose(np.quantile(cos**2, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.01)
    across = direction - cos[:, None] * NORMAL
    np.testing.assert_allclose(across.mean(axis=0), 0, atol=0.015)


def test_even_directions_find_a_window_with_less_noise(np_rng):
    """A twentieth of the lobe; 256 directions each time."""

    def noise(drawn):
        return np.std([(drawn(256, np_rng) @ [0, 0, 1] > 0.985).mean() for _ in range(200)])

    assert noise(even) < 0.6 * noise(random)
