"""The pixels of all training views, from which each step draws some."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.model.networks import SceneBox
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.volume.rendering import Rays

_MEDIAN = 0.2
"""Radiance that the median pixel is brought to: photographs have any unit."""
BYTES_A_PIXEL = 64
"""Of memory."""


@dataclass(frozen=True)
class PixelBatch:
    """Pixels of a step.

    Attributes
    ----------
    rays
        Theirs, half sides of the scene box.
    radiance
        (R, 3) linear RGB; all 0 where the photograph tells nothing.
    distance
        (R,) to the surface, half sides; 0 where unknown.
    confidence
        (R,) of it, in units of the median; at most 1.
    normal
        (R, 3) unit normals that face the camera; 0 where unknown.
    """

    rays: Rays
    radiance: torch.Tensor
    distance: torch.Tensor
    confidence: torch.Tensor
    normal: torch.Tensor


class VolumePixels:
    """Pixels of views, with their rays, radiance and depth.

    Parameters
    ----------
    views
        With the depth maps that are to be met.
    box
        Scene box.
    keep
        (H, W) bool of each view: pixels that are drawn; default: all.
    """

    def __init__(self, views: Sequence[DepthView], box: SceneBox, keep: Sequence[np.ndarray] | None = None) -> None:
        chosen = [np.ones(v.map.depth.shape, bool) for v in views] if keep is None else keep
        self.half_side = box.side / 2

        def joined(parts: Sequence[np.ndarray]) -> np.ndarray:
            return np.concatenate([part[mask] for part, mask in zip(parts, chosen, strict=True)])

        self._view = np.repeat(np.arange(len(views)), [int(mask.sum()) for mask in chosen])
        self._center = box.to_signed(np.array([view.camera.center for view in views])).astype(np.float32)
        self._ray = joined([view.rays.astype(np.float32) for view in views])
        self._depth = joined([view.map.depth for view in views])
        self._normal = joined([view.map.normal for view in views])
        confidence, radiance = joined([v.map.confidence for v in views]), joined([v.radiance for v in views])
        known, light = self._depth > 0, radiance.mean(axis=1)
        if not (light > 0).any():
            raise FiptError("the photographs must show light; all pixels are black", "look at them with fipt qa")
        usual = float(np.median(confidence[known])) if known.any() else 1.0
        self._confidence = np.minimum(confidence / max(usual, 1e-9), 1.0).astype(np.float32)
        self._radiance = radiance * np.float32(_MEDIAN / np.median(light[light > 0]))

    def __len__(self) -> int:
        """How many."""
        return len(self._view)

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,) numbers of pixels, any of any view."""
        return rng.integers(len(self), size=count)

    def batch(self, chosen: np.ndarray, device: torch.device) -> PixelBatch:
        """Pixels of these numbers, on a device."""
        ray = self._ray[chosen]
        length = np.linalg.norm(ray, axis=1)

        def there(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(values, np.float32)).to(device)

        return PixelBatch(
            Rays(there(self._center[self._view[chosen]]), there(ray / length[:, None])),
            there(self._radiance[chosen]),
            there(self._depth[chosen] * length / self.half_side),
            there(self._confidence[chosen]),
            there(self._normal[chosen]),
        )
