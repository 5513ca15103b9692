"""Propagation within parts: all of a part has one roughness and one metallic.

L   = mean over samples of |m - m_k|  +  mean over samples of |s - s_k|
s_k = sum over the part's samples of w s  /  sum of w,    m_k likewise

k       the sample's part; samples of no part are left out
s, m    roughness and metallic of the sample
w       its specular radiance, plus 1e-4: where a highlight is seen, roughness is known (passes no gradient)
"""

import torch


def part_propagation(
    roughness: torch.Tensor, metallic: torch.Tensor, specular: torch.Tensor, segment: torch.Tensor
) -> torch.Tensor:
    """L of roughness, metallic, specular radiance (H,) and segments (H,) int64, 0 = of no part."""
    known = segment > 0
    if not known.any():
        return roughness.new_zeros(())
    _, part = torch.unique(segment[known], return_inverse=True)
    weight = specular.detach()[known] + 1e-4
    count = int(part.max()) + 1
    total = weight.new_zeros(count).index_add(0, part, weight)
    loss = roughness.new_zeros(())
    for value in (roughness[known], metallic[known]):
        mean = value.new_zeros(count).index_add(0, part, value * weight) / total
        loss = loss + (value - mean[part]).abs().mean()
    return loss
