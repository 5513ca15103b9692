"""How sure the part search is: sharp residuals are sure, flat ones take what the class and the room know."""

import numpy as np
import pytest

from fipt.stages.fit.material_posterior import no_parts, posterior

LEVELS = np.array([0.02, 0.25, 0.5, 0.75, 1.0])


def residual(*least):
    """(2, L, S): a sharp minimum at each (metal, level), or the same everywhere (None)."""
    result = np.ones((2, len(LEVELS), len(least)))
    for segment, place in enumerate(least):
        if place is not None:
            result[:, :, segment] = 2
            result[(*place, segment)] = 1
    return result


def test_a_sharp_minimum_is_sure():
    found = posterior(LEVELS, residual(None, (0, 1), (1, 2)), np.array([0, 10_000, 10_000]))
    segment = np.array([1, 2])
    np.testing.assert_allclose(found.probability.sum(axis=(0, 1)), 1)
    np.testing.assert_allclose(found.metal(segment), [0, 1], atol=1e-6)
    np.testing.assert_allclose(found.roughness_error(segment, np.array([0.25, 0.5])), 0, atol=1e-6)
    np.testing.assert_allclose(found.roughness_error(segment, np.array([0.75, 0.5])), [0.5, 0], atol=1e-6)


def test_few_pixels_say_less():
    slope = residual((0, 1)) ** 0.1
    many, few, hardly = (posterior(LEVELS, slope, np.array([n])) for n in (10_000, 100, 3))
    errors = [float(found.roughness_error(np.zeros(1, int), LEVELS[1:2])[0]) for found in (many, few, hardly)]
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] == pytest.approx(
        float(no_parts(LEVELS, 1).roughness_error(np.zeros(1, int), LEVELS[1:2])[0]), rel=0.3
    )


def test_what_shows_nothing_is_like_its_class():
    """Segments 1 to 6 are sharp, of class 1 rough and of class 2 smooth metal; 7 and 8 show nothing."""
    sharp = [(0, 4)] * 3 + [(1, 0)] * 3
    free = np.array([0] + [10_000] * 6 + [100, 100])
    classes = np.array([0, 1, 1, 1, 2, 2, 2, 1, 2])
    found = posterior(LEVELS, residual(None, *sharp, None, None), free, classes)
    rough, metal = np.array([7]), np.array([8])
    assert found.metal(rough) < 0.2 < 0.8 < found.metal(metal)
    assert found.roughness_error(rough, np.ones(1)) < 0.2
    assert found.roughness_error(metal, LEVELS[:1]) < 0.2
    alone = posterior(LEVELS, residual(None, *sharp, None, None), free)
    assert 0.3 < alone.metal(metal) < 0.7


def test_without_parts_anything_is_possible():
    nothing = no_parts(LEVELS, 3)
    np.testing.assert_allclose(nothing.probability.sum(axis=(0, 1)), 1)
    assert nothing.metal(np.array([2])) == pytest.approx(0.1)
    assert nothing.roughness_error(np.array([1]), np.ones(1)) == pytest.approx(0.5, abs=0.05)
