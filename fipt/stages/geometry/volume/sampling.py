"""Where along a ray the field is asked: near a surface that is known, or so that the error of opacity is bounded."""

from dataclasses import dataclass

import numpy as np
import torch

from fipt.stages.geometry.mesh_settings import MonosdfGeometry
from fipt.stages.geometry.volume.density import laplace_density
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.rendering import Rays, shares

_HALVINGS = 10
"""Of the interval in which the width of the density is sought."""
_MOST_ERROR = 12.0
"""Exponent of the bound above which it is all the same."""
_MOST_EXPONENT = 60.0
"""Of what vanishes: smaller numbers are slow, and tell nothing."""


def spread(low: torch.Tensor, high: torch.Tensor, jitter: torch.Tensor) -> torch.Tensor:
    """(R, S) sorted distances between ``low`` and ``high`` (R,): one in each of S equal parts, where jitter says."""
    count = jitter.shape[1]
    share = (torch.arange(count, device=jitter.device) + jitter) / count
    return low[:, None] + (high - low)[:, None] * share


@dataclass(frozen=True)
class ErrorBounded:
    """Sampling of VolSDF: along the whole ray, denser where the opacity would else be wrong by more than ``error``."""

    settings: MonosdfGeometry

    @torch.no_grad()
    def __call__(
        self, field: VolumeField, rays: Rays, step: float, _: np.ndarray, generator: torch.Generator
    ) -> torch.Tensor:
        """(R, S) sorted distances along rays, half sides."""
        wanted, near, far = self.settings, torch.zeros(len(rays), device=rays.way.device), rays.leave()

        def uniform(count: int) -> torch.Tensor:
            return torch.rand(len(rays), count, generator=generator).to(far.device)

        t = spread(near, far, uniform(wanted.first_samples))
        distance = self._distance(field, rays, t, step)
        least = field.density.beta.expand(len(rays))[:, None]
        beta = least
        for left in range(wanted.sampling_rounds, -1, -1):
            beta = bounded_width(t, distance, least, wanted.error)
            if left == 0 or bool((beta <= least).all()):
                break
            more = quantiles(t, error_bound(t, distance, beta), uniform(wanted.first_samples).sort(dim=1).values)
            t, order = torch.cat([t, more], dim=1).sort(dim=1)
            distance = torch.cat([distance, self._distance(field, rays, more, step)], dim=1).gather(1, order)
        seen = shares(t, laplace_density(distance, beta))[:, :-1]
        fine = quantiles(t, seen, spread(near, near + 1, uniform(wanted.samples)))
        even = spread(near, far, uniform(wanted.even_samples))
        return torch.cat([near[:, None], fine, even, far[:, None]], dim=1).sort(dim=1).values

    @staticmethod
    def _distance(field: VolumeField, rays: Rays, t: torch.Tensor, step: float) -> torch.Tensor:
        return field.distance(rays.at(t).reshape(-1, 3), step).view(t.shape)


@dataclass(frozen=True)
class NarrowBand:
    """Few places around a surface that is known.

    Attributes
    ----------
    distance
        (P,) float32 to it, of each pixel, half sides.
    width
        Half sides before and behind it.
    samples
        Places on a ray.
    """

    distance: np.ndarray
    width: float
    samples: int

    def __call__(
        self, _field: VolumeField, rays: Rays, _step: float, chosen: np.ndarray, generator: torch.Generator
    ) -> torch.Tensor:
        """(R, S) sorted distances along the rays of chosen pixels, half sides."""
        middle = torch.from_numpy(self.distance[chosen]).to(rays.way.device)
        jitter = torch.rand(len(rays), self.samples, generator=generator).to(middle.device)
        return spread((middle - self.width).clamp_min(0), middle + self.width, jitter)


def error_bound(t: torch.Tensor, distance: torch.Tensor, beta: torch.Tensor) -> torch.Tensor:
    """(R, S - 1) most by which the opacity up to the end of each interval may be wrong (VolSDF, equation 14).

    Parameters
    ----------
    t, distance
        (R, S) sorted distances along the ray, and the signed distances there.
    beta
        (R, 1) width of the density.
    """
    return _bound(t.diff(dim=1), distance[:, :-1], _nearest(t, distance), beta)


def _bound(delta: torch.Tensor, distance: torch.Tensor, nearest: torch.Tensor, beta: torch.Tensor) -> torch.Tensor:
    """`error_bound` of intervals (R, S - 1): lengths, distances at their begin, and least ones within."""
    near = torch.exp((-nearest / beta).clamp_min(-_MOST_EXPONENT))
    wrong = (near * (delta / (2 * beta)) ** 2).cumsum(dim=1)
    optical = (laplace_density(distance, beta) * delta).cumsum(dim=1)
    return torch.expm1(wrong.clamp_max(_MOST_ERROR)) * torch.exp(-optical.clamp_max(_MOST_EXPONENT))


def _nearest(t: torch.Tensor, distance: torch.Tensor) -> torch.Tensor:
    """(R, S - 1) least distance that a surface may have within each interval: balls at both ends are free of it."""
    delta, one, other = t.diff(dim=1), distance[:, :-1].abs(), distance[:, 1:].abs()
    half = 0.5 * (delta + one + other)
    area = (half * (half - delta) * (half - one) * (half - other)).clamp_min(0).sqrt()
    height = 2 * area / delta.clamp_min(1e-9)
    beyond = (one**2 - other**2).abs() >= delta**2  # the nearest place is an end
    least = torch.where(beyond, torch.minimum(one, other), height)
    return torch.where(distance[:, :-1] * distance[:, 1:] > 0, least, torch.zeros_like(least))


def bounded_width(t: torch.Tensor, distance: torch.Tensor, least: torch.Tensor, error: float) -> torch.Tensor:
    """(R, 1) smallest width, at least ``least`` (R, 1), at which the opacity is wrong by ``error`` at most."""
    delta, nearest = t.diff(dim=1), _nearest(t, distance)

    def good(beta: torch.Tensor) -> torch.Tensor:
        return _bound(delta, distance[:, :-1], nearest, beta).amax(dim=1, keepdim=True) <= error

    # at this width the bound holds whatever the distances are (VolSDF, lemma 2)
    enough = ((delta**2).sum(dim=1, keepdim=True) / (4 * torch.log1p(torch.full_like(least, error)))).sqrt()
    low, high = least, torch.maximum(enough, least)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fits = good(middle)
        low, high = torch.where(fits, low, middle), torch.where(fits, middle, high)
    return torch.where(good(least), least, high)


def quantiles(edges: torch.Tensor, weight: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    """Places (R, K) of quantiles ``share`` of densities: weights (R, S - 1) are even between (R, S) edges."""
    weight = weight + 1e-5
    total = torch.cat([torch.zeros_like(weight[:, :1]), weight.cumsum(dim=1)], dim=1)
    total = total / total[:, -1:]
    upper = torch.searchsorted(total, share.contiguous(), right=True).clamp(1, weight.shape[1])
    low, high = total.gather(1, upper - 1), total.gather(1, upper)
    within = ((share - low) / (high - low).clamp_min(1e-12)).clamp(0, 1)
    start, end = edges.gather(1, upper - 1), edges.gather(1, upper)
    return start + within * (end - start)
