"""Propagation within semantic segments: alike, nearby samples of a segment have the same roughness and metallic.

L    = sum over segments of the mean over their samples of |s - s~| + |m - m~|
s~   = sum over j of w_j s_j  /  sum of w_j,    m~ likewise
w_j  = exp(-|a - a_j|^2 / 2 sigma_a^2) exp(-|x - x_j|^2 / 2 sigma_x^2)     (passes no gradient)

s, m      roughness and metallic of the sample
j         up to 1,024 samples of the same segment in the batch
a         base colour, sigma_a = 0.05 / 3
x         position in the scene box, in [-1, 1], sigma_x = 0.3 / 3
"""

import torch

_SAMPLES = 1024
_SIGMA_COLOR = 0.05 / 3
_SIGMA_POSITION = 0.3 / 3


def semantic_propagation(
    roughness: torch.Tensor,
    metallic: torch.Tensor,
    base_color: torch.Tensor,
    position: torch.Tensor,
    segment: torch.Tensor,
) -> torch.Tensor:
    """L of roughness, metallic (H,), base colour, position in the box (H, 3), segment (H,) int64, 0 = unknown."""
    loss = roughness.new_zeros(())
    features = torch.cat([base_color.detach() / _SIGMA_COLOR, position / _SIGMA_POSITION], dim=1)
    for label in torch.unique(segment[segment > 0]):
        own = torch.nonzero(segment == label)[:, 0]
        others = own[:_SAMPLES]  # batches are shuffled: the first ones are a random choice
        with torch.no_grad():
            weight = torch.exp(-0.5 * torch.cdist(features[own], features[others]).square())
            weight = weight / weight.sum(1, keepdim=True).clamp_min(1e-12)
        for value in (roughness, metallic):
            loss = loss + (value[own] - weight @ value[others]).abs().mean()
    return loss
