"""The diffuse prior: surfaces are rough and no metal unless the photographs ask for it.

L = mean over samples of (1 - s)  +  mean over samples of m

s, m    roughness and metallic, averaged over the sample's points
"""

import torch


def diffuse_prior(roughness: torch.Tensor, metallic: torch.Tensor) -> torch.Tensor:
    """L of roughness and metallic (H,)."""
    return (1 - roughness).mean() + metallic.mean()
