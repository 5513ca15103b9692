"""Density from distance, as VolSDF has it (Yariv et al. 2021): the distribution function of Laplace."""

import torch
from torch import nn

_LEAST = 1e-4
"""Half sides: the least width of the density."""
_VANISHES = -60.0
"""Exponent of a density that is none: smaller numbers are slow, and tell nothing."""


class Density(nn.Module):
    """Density of matter at signed distances; its width ``beta`` is learned.

    Parameters
    ----------
    beta
        First width, half sides of the scene box.
    """

    def __init__(self, beta: float) -> None:
        super().__init__()
        self.first = beta
        self.scale = nn.Parameter(torch.ones(()))

    @property
    def beta(self) -> torch.Tensor:
        """Width, half sides."""
        return _LEAST + self.first * self.scale

    @torch.no_grad()
    def bound(self) -> None:
        """Keep the width between the least and the first one: what does not fit yet would widen it at first."""
        self.scale.clamp_(0.0, 1.0)

    def forward(self, distance: torch.Tensor) -> torch.Tensor:
        """Density per half side."""
        return laplace_density(distance, self.beta)


def laplace_density(distance: torch.Tensor, beta: torch.Tensor) -> torch.Tensor:
    """1 / beta in matter, half of it on the surface, falling to 0 in free space (positive distance)."""
    tail = 0.5 * torch.exp((-distance.abs() / beta).clamp_min(_VANISHES))
    return torch.where(distance > 0, tail, 1 - tail) / beta
