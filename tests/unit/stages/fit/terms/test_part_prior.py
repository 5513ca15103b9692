"""The part prior: the distance of logits."""

import numpy as np
import pytest
import torch

from fipt.stages.fit.terms.part_prior import logit_distance


def test_distance_of_logits_is_squared_near_the_goal_and_linear_far_away():
    goal = torch.full((5,), 0.3)
    logit = float(np.log(0.3 / 0.7))
    x = (logit + torch.tensor([0.0, 0.25, -0.25, 2.0, -3.0])).requires_grad_()
    distance = logit_distance(torch.sigmoid(x), goal)
    np.testing.assert_allclose(distance.detach(), [0, 0.0625, 0.0625, 1.75, 2.75], atol=1e-5)
    distance.sum().backward()
    np.testing.assert_allclose(x.grad, [0, 0.5, -0.5, 1, -1], atol=1e-4)


def test_goals_keep_off_the_ends_of_the_sigmoid():
    """One can be reached, and a saturated value still has a gradient."""
    ends = torch.tensor([0.0, 1.0])
    assert logit_distance(torch.tensor([0.004, 0.996]), ends).tolist() == pytest.approx([0, 0], abs=1e-6)
    x = torch.tensor([-8.0, 8.0], requires_grad=True)
    logit_distance(torch.sigmoid(x), torch.tensor([0.5, 0.5])).sum().backward()
    np.testing.assert_allclose(x.grad, [-1, 1], rtol=0.02)
