"""The smoothness prior: small changes of base colour within a pixel's footprint are errors of its shading.

    L_s = mean over samples of t^2 (1 - exp(-v / t^2))

    v      mean square, over a sample's points and channels, of ln(a + 0.01) less its mean over the points
    a      base colour
    t      0.1: two points that differ by 20 % may be either

What differs by more is texture, and costs no more: edges stay. It is not in the paper.
"""

import torch

_SCALE = 0.1
"""t. Errors of the shading are 0.06 to 0.2 on plain surface, in logarithms."""
_DARKEST = 0.01
"""Base colour that is added before the logarithm: below it differences are noise."""


def smoothness(base_color: torch.Tensor, queries: int) -> torch.Tensor:
    """L_s of the base colours (N * queries, 3) of N samples."""
    level = (base_color.view(-1, queries, 3) + _DARKEST).log()
    variance = (level - level.mean(1, keepdim=True)).square().mean((1, 2))
    return (_SCALE**2 * -torch.expm1(-variance / _SCALE**2)).mean()
