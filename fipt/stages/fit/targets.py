"""What the surface of each segment is drawn to: goals from the part search, for the priors of the loss."""

from dataclasses import dataclass

import numpy as np
import torch

from fipt.stages.fit.part_search import PartEstimates
from fipt.stages.fit.settings import FitSettings

_TRUST = 20.0
"""How much a part's weight grows with the share of the residual that its estimate removes."""


@dataclass(frozen=True)
class PartTargets:
    """Goals of segments: torch, float32, a row a segment (or a sample).

    Attributes
    ----------
    roughness, metallic, weight
        (S,) the two goals, and the weight of the part prior.
    base_color, uniform
        (S, 3) and (S,) the colour, and how much rather the segment has but one.
    """

    roughness: torch.Tensor
    metallic: torch.Tensor
    weight: torch.Tensor
    base_color: torch.Tensor
    uniform: torch.Tensor

    def of(self, segment: torch.Tensor) -> "PartTargets":
        """Rows of segments (N,) int64."""
        return PartTargets(*(values[segment] for values in vars(self).values()))

    def to(self, device: torch.device) -> "PartTargets":
        """The same on a device."""
        return PartTargets(*(values.to(device) for values in vars(self).values()))


def part_targets(found: PartEstimates, settings: FitSettings) -> PartTargets:
    """Goals of every segment.

    Their weight grows with what the search explained; what has no segment is drawn to matte, as by the diffuse prior.
    """
    weight = settings.target_weight * (1 + _TRUST * np.maximum(found.gain, 0))
    weight[0] = settings.diffuse_weight
    white = settings.whitest + (1 - settings.whitest) * found.metallic[:, None]  # the network says no more
    goals = (found.roughness, found.metallic, weight, np.minimum(found.base_color, white), found.uniform)
    return PartTargets(*(torch.from_numpy(values.astype(np.float32)) for values in goals))
