"""What a rendered batch is judged by: photographs, depth, normals, and what any signed distance obeys."""

from dataclasses import dataclass

import torch
from torch.nn import functional

from fipt.model.srgb import srgb
from fipt.stages.geometry.mesh_settings import VolumeGeometry
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.pixels import PixelBatch
from fipt.stages.geometry.volume.rendering import Rendered

_DEPTH_UNIT = 25.0
"""Depth is compared in fiftieths of the box's side, as MonoSDF does; beyond one of them, outliers count linearly."""
_BESIDE = 0.005
"""Half sides to the places whose normals shall be alike."""


@dataclass(frozen=True)
class VolumeLoss:
    """The loss, term by term."""

    settings: VolumeGeometry

    def terms(
        self, field: VolumeField, batch: PixelBatch, seen: Rendered, step: float, offsets: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Terms of a batch; (R, 3) ``offsets`` in ±1 say which places have normals like those on the rays' surface."""
        wanted = self.settings
        lit = (batch.radiance > 0).any(dim=1).float()
        color = (srgb(seen.radiance) - srgb(batch.radiance)).abs().mean(dim=1)
        terms = {
            "color": _mean(color, lit),
            "depth": wanted.depth_weight * _depth(seen.distance - batch.distance, batch),
            "normal": wanted.normal_weight * _normal(seen.normal, batch),
        }
        terms["eikonal"] = wanted.eikonal_weight * ((seen.gradients.norm(dim=2) - 1) ** 2).mean(dim=1).mean()
        if wanted.smooth_weight:
            surface = batch.rays.at(seen.distance.detach()[:, None])[:, 0]
            both = torch.cat([surface, surface + _BESIDE * offsets])
            normal = functional.normalize(field.around(both, step).gradient, dim=1)
            here, beside = normal.chunk(2)
            terms["smooth"] = wanted.smooth_weight * (here - beside).norm(dim=1).mean()
        return terms


def _depth(off: torch.Tensor, batch: PixelBatch) -> torch.Tensor:
    """Squared difference of distances (R,), linear where it is large, by confidence."""
    off = _DEPTH_UNIT * off
    return _mean(2 * functional.huber_loss(off, torch.zeros_like(off), reduction="none"), batch.confidence)


def _normal(normal: torch.Tensor, batch: PixelBatch) -> torch.Tensor:
    """L1 difference of normals (R, 3), and 1 - the cosine between them, by confidence."""
    normal = functional.normalize(normal, dim=1)
    known = (batch.normal**2).sum(dim=1) > 0.5
    off = (normal - batch.normal).abs().sum(dim=1) + 1 - (normal * batch.normal).sum(dim=1)
    return _mean(off, known * batch.confidence)


def _mean(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Mean of (R,) values of all pixels that count at all, by weight."""
    return (values * weight).sum() / (weight > 0).sum().clamp_min(1)
