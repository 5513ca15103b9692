"""Rays through the field: what they see."""

from dataclasses import dataclass

import torch

from fipt.stages.geometry.volume.field import VolumeField

_MOST_OPTICAL = 60.0
"""Optical depth behind which nothing is seen: smaller numbers are slow."""


@dataclass(frozen=True)
class Rays:
    """Rays in half sides of the scene box: origins (R, 3), unit directions (R, 3)."""

    origin: torch.Tensor
    way: torch.Tensor

    def __len__(self) -> int:
        """How many."""
        return len(self.origin)

    def at(self, t: torch.Tensor) -> torch.Tensor:
        """(R, S, 3) places at distances (R, S)."""
        return self.origin[:, None] + t[..., None] * self.way[:, None]

    def leave(self) -> torch.Tensor:
        """(R,) distances at which they leave the cube [-1, 1]."""
        way = torch.where(self.way.abs() > 1e-6, self.way, torch.full_like(self.way, 1e-6))
        return ((way.sign() - self.origin) / way).amin(dim=1).clamp_min(1e-3)


@dataclass(frozen=True)
class Rendered:
    """What rays see: radiance (R, 3), distance (R,) in half sides, normal (R, 3); gradients (R, S, 3) on the way."""

    radiance: torch.Tensor
    distance: torch.Tensor
    normal: torch.Tensor
    gradients: torch.Tensor


def render(field: VolumeField, rays: Rays, t: torch.Tensor, step: float) -> Rendered:
    """Render rays through places at sorted distances (R, S); the last place stands for all behind it.

    Parameters
    ----------
    step
        At which the field is seen, half sides.
    """
    count, samples = t.shape
    places = rays.at(t).reshape(-1, 3)
    ways = rays.way[:, None].expand(count, samples, 3).reshape(-1, 3)
    there = field.around(places, step)
    light = field.radiance(places, ways, there).view(count, samples, 3)
    weight = weights(t, field.density(there.distance.view(count, samples)))
    gradients = there.gradient.view(count, samples, 3)
    return Rendered(
        radiance=(weight[..., None] * light).sum(1),
        distance=(weight * t).sum(1),
        normal=(weight[..., None] * gradients).sum(1),
        gradients=gradients,
    )


def weights(t: torch.Tensor, density: torch.Tensor) -> torch.Tensor:
    """(R, S) share of what a ray sees that each place shows; they sum to 1.

    Half of what an interval shows counts for either end: else few places put the surface half an interval off.
    """
    shown = shares(t, density)
    half = 0.5 * shown[:, :-1]
    return torch.cat([half[:, :1], half[:, :-1] + half[:, 1:], half[:, -1:] + shown[:, -1:]], dim=1)


def shares(t: torch.Tensor, density: torch.Tensor) -> torch.Tensor:
    """(R, S) share of what a ray sees that each interval between places shows, and what is behind the last.

    Density is linear between places.
    """
    optical = 0.5 * (density[:, :-1] + density[:, 1:]) * t.diff(dim=1)
    passed = torch.exp(-torch.cat([torch.zeros_like(t[:, :1]), optical.cumsum(dim=1)], dim=1).clamp_max(_MOST_OPTICAL))
    return torch.cat([passed[:, :-1] - passed[:, 1:], passed[:, -1:]], dim=1)
