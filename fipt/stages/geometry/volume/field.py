"""Signed distance and radiance at every place of a room: a known start, and a network that learns the rest."""

import itertools
import math
from dataclasses import dataclass
from typing import cast

import torch
from torch import nn

from fipt.model.hash_encoding import Backend, HashEncoding
from fipt.model.networks import linear
from fipt.stages.geometry.mesh_settings import VolumeGeometry
from fipt.stages.geometry.volume.density import Density

TAPS = torch.tensor([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
"""Corners of a tetrahedron: the fewest places whose distances tell a gradient."""
COARSEST = 16
"""Cells along a side of the box, of the coarsest grid."""
_PLACE_BANDS, _WAY_BANDS = 6, 4
"""Frequencies of the sines that places and directions are given as."""
_FIRST_RADIANCE = 0.2
"""Of every place: a ReLU that starts shut never opens. Pixels are scaled so that this is their median."""


@dataclass(frozen=True)
class Surroundings:
    """What the field says around (N, 3) places: distance (N,), its gradient (N, 3), features (N, F)."""

    distance: torch.Tensor
    gradient: torch.Tensor
    features: torch.Tensor


class VolumeField(nn.Module):
    """Signed distance and radiance in the cube [-1, 1], in half sides of the scene box; free space is positive.

    The distance is ``start`` plus what a network says, which is 0 at first. The hash encoding passes no gradients on to
    places, so gradients of the distance are differences between four places at ``step`` around; levels of the encoding
    that are finer than that are faded.

    Parameters
    ----------
    start
        Distances (N,) of (N, 3) places, without parameters.
    settings
        Sizes and seed.
    beta
        First width of the density, half sides.
    directional
        Whether radiance depends on the direction that it is seen from.
    backend
        Of the hash encoding.

    Attributes
    ----------
    learns_distance
        Whether gradients reach the distance; else radiance alone is learned.
    """

    taps: torch.Tensor

    def __init__(
        self,
        start: nn.Module,
        settings: VolumeGeometry,
        beta: float,
        directional: bool = True,
        backend: Backend = "auto",
    ) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(settings.seed + 1)
        growth = (settings.finest / COARSEST) ** (1 / max(settings.levels - 1, 1))
        width = settings.width
        self.start, self.density, self.directional = start, Density(beta), directional
        self.encoding = HashEncoding(
            settings.levels, settings.table_log2, base_resolution=COARSEST, growth=growth, seed=settings.seed,
            backend=backend,
        )  # fmt: skip
        inputs = settings.levels * self.encoding.features + 3 + 6 * _PLACE_BANDS
        self.distance_network = _mlp(inputs, width, 1 + width, generator)
        self.radiance_network = _mlp(width + 9 + 6 * _WAY_BANDS, width, 3, generator)
        distance, radiance = (cast("nn.Linear", net[-1]) for net in (self.distance_network, self.radiance_network))
        with torch.no_grad():
            distance.weight[0], distance.bias[0] = 0.0, 0.0
            radiance.bias.fill_(_FIRST_RADIANCE)
        self.register_buffer("taps", TAPS.clone(), persistent=False)
        self.learns_distance = True

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.taps.device

    def distance(self, points: torch.Tensor, step: float) -> torch.Tensor:
        """(N,) distances of (N, 3) places, of a surface as it is seen at a step."""
        return self.start(points) + self.learned(points, step)

    def learned(self, points: torch.Tensor, step: float) -> torch.Tensor:
        """(N,) what was learned of them, beyond the start."""
        return self._outputs(points, step)[:, 0]

    def around(self, points: torch.Tensor, step: float) -> Surroundings:
        """Distance, gradient and features at (N, 3) places, from four places at ``step`` half sides around each."""
        places = (points + step * self.taps[:, None]).reshape(-1, 3)
        outputs = self._outputs(places, step).view(4, len(points), -1)
        learned = outputs[..., 0] if self.learns_distance else outputs[..., 0].detach()
        distance = learned + self.start(places).view(4, -1)
        gradient = (self.taps[:, None] * distance[..., None]).sum(0) / (4 * step)
        return Surroundings(distance.mean(0), gradient, outputs[..., 1:].mean(0))

    def radiance(self, points: torch.Tensor, ways: torch.Tensor, there: Surroundings) -> torch.Tensor:
        """Linear RGB (N, 3) that leaves (N, 3) places against (N, 3) unit directions of rays."""
        normal = nn.functional.normalize(there.gradient, dim=1)
        ways = ways if self.directional else torch.zeros_like(ways)
        inputs = [points, ways, _waves(ways, _WAY_BANDS), normal, there.features]
        return torch.relu(self.radiance_network(torch.cat(inputs, dim=1)))

    def _outputs(self, points: torch.Tensor, step: float) -> torch.Tensor:
        """(N, 1 + F) of the distance network."""
        seen = torch.full_like(points[:, 0], step)
        encoded = self.encoding(0.5 * points + 0.5, seen)
        return self.distance_network(torch.cat([encoded, points, _waves(points, _PLACE_BANDS)], dim=1))


def _mlp(inputs: int, width: int, outputs: int, generator: torch.Generator) -> nn.Sequential:
    """Two hidden layers."""
    sizes = [inputs, width, width, outputs]
    layers = [linear(one, other, generator) for one, other in itertools.pairwise(sizes)]
    return nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])


def _waves(values: torch.Tensor, bands: int) -> torch.Tensor:
    """Sines and cosines (N, 6 * bands) of pi, 2 pi, 4 pi, ... times (N, 3) values, each from those of half of it."""
    sine, cosine = (math.pi * values).sin(), (math.pi * values).cos()
    found = []
    for _ in range(bands):
        found += [sine, cosine]
        sine, cosine = 2 * sine * cosine, 1 - 2 * sine * sine
    return torch.cat(found, dim=1)
