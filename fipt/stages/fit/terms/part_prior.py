"""The part prior: roughness and metallic of a sample are near those that the search found for its part.

    L_h = w_k (d(s, s_k) + d(m, m_k))
    d(x, y) = huber(logit x - logit y)

    k           the sample's part
    s, m        roughness and metallic of the sample
    s_k, m_k    those found for the part; w_k the weight, which grows with what the part's pixels said
    huber       x^2 up to |x| = 0.5, linear beyond

It stands in for the diffuse prior where parts were searched, and is not in the paper.
"""

import torch

from fipt.stages.fit.targets import PartTargets


def part_prior(roughness: torch.Tensor, metallic: torch.Tensor, part: PartTargets) -> torch.Tensor:
    """(N,) L_h of samples with roughness and metallic (N,); ``part`` has the row of each sample's part."""
    distance = logit_distance(roughness, part.roughness) + logit_distance(metallic, part.metallic)
    return part.weight * distance


def logit_distance(value: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
    """Distance d (N,): it has the same gradient where a sigmoid has saturated, and an ever smaller one near the goal.

    Goals keep off the sigmoid's ends. Near the goal the distance is squared: a gradient that keeps its size there would
    only add noise to the optimiser's steps.
    """
    value, goal = (x.clamp(low, 1 - low) for x, low in ((value, 1e-4), (goal, 0.004)))
    return torch.nn.functional.smooth_l1_loss(torch.logit(value), torch.logit(goal), reduction="none", beta=0.5)
