"""The base colour prior: a part that seems to have one base colour keeps it.

    L_h = u_k mean over points and channels of (a - a_k)^2

    a      base colour of the sample
    a_k    median base colour that the search found for its part
    u_k    error over texture of the part's base colours, from 0 (textured, or not known) to 8

In such a part the photographs' differences are errors of the shading rather than texture. So the data term's gradient
of a is also scaled, by 1 / (1 + u_k). It is not in the paper.
"""

from dataclasses import replace

import torch

from fipt.model.reflectance import Brdf
from fipt.stages.fit.targets import PartTargets


def base_color_prior(base_color: torch.Tensor, part: PartTargets, queries: int) -> torch.Tensor:
    """(N,) mean square difference of base colours (N * queries, 3) from those of their parts, without u_k."""
    return (base_color.view(-1, queries, 3) - part.base_color[:, None]).square().mean((1, 2))


def with_scaled_gradient(brdf: Brdf, part: PartTargets, queries: int) -> Brdf:
    """The same reflectance (N * queries), whose base colour passes 1 / (1 + u_k) of its gradient."""
    share = (part.uniform / (1 + part.uniform)).repeat_interleave(queries)[:, None]
    return replace(brdf, base_color=torch.lerp(brdf.base_color, brdf.base_color.detach(), share))
