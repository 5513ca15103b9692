"""Small changes of base colour within a footprint cost their square; edges cost a bounded sum and pull no more."""

import numpy as np
import pytest
import torch

from fipt.stages.fit.terms.base_color_smoothness import base_color_smoothness


def pair(change: float) -> torch.Tensor:
    """Base colours of one sample's two points whose logarithms, 0.01 added, differ by so much."""
    first = torch.full((1, 3), 0.3)
    return torch.cat([first, (first + 0.01) * np.exp(change) - 0.01])


def test_a_small_change_costs_its_square():
    assert base_color_smoothness(pair(0.02), 2).item() == pytest.approx(0.01**2, rel=0.02)
    assert base_color_smoothness(pair(-0.02), 2).item() == pytest.approx(0.01**2, rel=0.02)


def test_an_edge_costs_a_bounded_sum_and_pulls_no_more():
    edge = pair(1.5).requires_grad_()
    cost = base_color_smoothness(edge, 2)
    cost.backward()
    assert cost.item() == pytest.approx(0.1**2, rel=1e-3)
    small = pair(0.1).requires_grad_()
    base_color_smoothness(small, 2).backward()
    assert edge.grad.abs().max() < 1e-6 * small.grad.abs().max()


def test_it_is_a_mean_over_samples_each_against_its_own_points():
    both = torch.cat([pair(0.02), pair(1.5) * 0.5, pair(0.0)])
    each = [base_color_smoothness(part, 2).item() for part in both.split(2)]
    assert base_color_smoothness(both, 2).item() == pytest.approx(np.mean(each), rel=1e-5)
    assert base_color_smoothness(both[::2].contiguous(), 1).item() == 0, "one point has no change"
    assert torch.isfinite(base_color_smoothness(torch.zeros(4, 3), 2))
