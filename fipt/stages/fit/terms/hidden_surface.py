"""The hidden surface: points that no view sees are like the part they belong to.

L = 1 / H * sum over hidden points of (lambda_base max(u_k, 1) |a - a_k|^2 + part prior)

H              samples of the batch: a hidden point weighs as much as one of them
a, a_k, u_k    as in the base colour prior; the colour counts with weight 1 at least, for no photograph tells another
lambda_base    weight of the base colour prior
"""

import torch

from fipt.model.reflectance import Brdf
from fipt.stages.fit.targets import PartTargets
from fipt.stages.fit.terms.base_color_prior import base_color_prior
from fipt.stages.fit.terms.part_prior import part_prior


def hidden_surface_term(brdf: Brdf, part: PartTargets, base_weight: float, samples: int) -> torch.Tensor:
    """L of hidden points with reflectance ``brdf`` (N) and the rows of their parts; ``samples`` is H."""
    base = base_weight * part.uniform.clamp_min(1) * base_color_prior(brdf.base_color, part, 1)
    return (base + part_prior(brdf.roughness, brdf.metallic, part)).sum() / samples
