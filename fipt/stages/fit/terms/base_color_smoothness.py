"""The smoothness prior of base colour: small changes within a pixel's footprint are errors of its shading.

    L_s = mean over samples of t^2 (1 - exp(-v / t^2))

    a      base colour
    v      mean square, over a sample's points and channels, of ln(a + 0.01) less its mean over the points
    t      0.1: two points that differ by 20 % may be either

What differs by more is texture, and costs no more: edges stay. It is not in the paper.
"""

import torch

from fipt.conventions import DARK_BASE_COLOR

_SCALE = 0.1
"""t. Errors of the shading are 0.06 to 0.2 on plain surface, in logarithms."""


def base_color_smoothness(base_color: torch.Tensor, queries: int) -> torch.Tensor:
    """L_s, a scalar, of the base colours (N * queries, 3) in [0, 1] of N samples."""
    level = (base_color.view(-1, queries, 3) + DARK_BASE_COLOR).log()
    variance = (level - level.mean(1, keepdim=True)).square().mean((1, 2))
    return (_SCALE**2 * -torch.expm1(-variance / _SCALE**2)).mean()
