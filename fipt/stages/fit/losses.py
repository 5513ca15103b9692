"""Losses of the fit (method.md, stage 2). All tensors float32; H samples with Q queries each, B pixels."""

import torch

from fipt.conventions import ROUGHNESS_LEVELS
from fipt.model.networks import Brdf

_LEVELS = len(ROUGHNESS_LEVELS)
_SEMANTIC_SAMPLES = 1024
_SIGMA_COLOUR = 0.05 / 3
_SIGMA_POSITION = 0.3 / 3


def srgb(linear: torch.Tensor) -> torch.Tensor:
    """SRGB curve, continued above 1."""
    safe = linear.clamp_min(0.0031308)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * safe ** (1 / 2.4) - 0.055)


def specular_at(shading: torch.Tensor, roughness: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Interpolate Ls0 and Ls1 linearly in roughness between the baked levels.

    Parameters
    ----------
    shading
        (H, outputs, 3).
    roughness
        (H, Q) in [0.02, 1].

    Returns
    -------
    (H, Q, 3) Ls0 and Ls1.
    """
    levels = roughness.new_tensor(ROUGHNESS_LEVELS)
    low = torch.bucketize(roughness.detach(), levels, right=True).sub(1).clamp(0, _LEVELS - 2)
    t = ((roughness - levels[low]) / (levels[low + 1] - levels[low]))[..., None]

    def at(first: int) -> torch.Tensor:
        rows = torch.arange(len(shading))[:, None]
        return torch.lerp(shading[rows, first + low], shading[rows, first + low + 1], t)

    return at(1), at(1 + _LEVELS)


def reflected(brdf: Brdf, shading: torch.Tensor, queries: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Reflected radiance kd Ld + ks Ls0(s) + Ls1(s) of each hit, averaged over its queries.

    Parameters
    ----------
    brdf
        Of H * Q points, queries of a hit adjacent.

    Returns
    -------
    radiance
        (H, 3).
    specular
        (H,) mean over RGB of its specular part.
    """
    count = len(shading)
    ls0, ls1 = specular_at(shading, brdf.roughness.view(count, queries))
    specular = brdf.ks.view(count, queries, 3) * ls0 + ls1
    diffuse = brdf.kd.view(count, queries, 3) * shading[:, None, 0]
    return (diffuse + specular).mean(1), specular.mean((1, 2))


def gathered(values: torch.Tensor, owner: torch.Tensor, weight: torch.Tensor, pixels: int) -> torch.Tensor:
    """Sum (H, 3) values of samples, by weight, into (B, 3) pixels."""
    return values.new_zeros(pixels, 3).index_add(0, owner, values * weight[:, None])


def part_propagation(
    roughness: torch.Tensor, metallic: torch.Tensor, evidence: torch.Tensor, segment: torch.Tensor
) -> torch.Tensor:
    """Distance of each hit's roughness and metallic (H,) from its part's mean, weighted by (H,) evidence."""
    known = segment > 0
    if not known.any():
        return roughness.new_zeros(())
    _, part = torch.unique(segment[known], return_inverse=True)
    weight = evidence.detach()[known] + 1e-4
    count = int(part.max()) + 1
    total = weight.new_zeros(count).index_add(0, part, weight)
    loss = roughness.new_zeros(())
    for value in (roughness[known], metallic[known]):
        mean = value.new_zeros(count).index_add(0, part, value * weight) / total
        loss = loss + (value - mean[part]).abs().mean()
    return loss


def semantic_propagation(
    roughness: torch.Tensor,
    metallic: torch.Tensor,
    base_color: torch.Tensor,
    position: torch.Tensor,
    segment: torch.Tensor,
) -> torch.Tensor:
    """Distance from the mean of alike, nearby samples of the same segment, summed over segments.

    Parameters
    ----------
    roughness, metallic
        (H,).
    base_color
        (H, 3).
    position
        (H, 3) in [-1, 1] of the scene box.
    segment
        (H,) int64, 0 = unknown.
    """
    loss = roughness.new_zeros(())
    colour, place = base_color.detach() / _SIGMA_COLOUR, position / _SIGMA_POSITION
    features = torch.cat([colour, place], dim=1)
    for label in torch.unique(segment[segment > 0]):
        own = torch.nonzero(segment == label)[:, 0]
        others = own[:_SEMANTIC_SAMPLES]  # batches are shuffled: the first ones are a random choice
        with torch.no_grad():
            weight = torch.exp(-0.5 * torch.cdist(features[own], features[others]).square())
            weight = weight / weight.sum(1, keepdim=True).clamp_min(1e-12)
        for value in (roughness, metallic):
            loss = loss + (value[own] - weight @ value[others]).abs().mean()
    return loss


def apart(value: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
    """Distance (H,) of logits: it pulls as hard where a sigmoid has saturated, and ever less near the goal.

    Goals keep off the sigmoid's ends. Near the goal the distance is squared: a pull that keeps its strength there would
    only add noise to the optimiser's steps.
    """
    value, goal = (x.clamp(low, 1 - low) for x, low in ((value, 1e-4), (goal, 0.004)))
    return torch.nn.functional.smooth_l1_loss(torch.logit(value), torch.logit(goal), reduction="none", beta=0.5)
