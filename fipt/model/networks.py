"""The networks that are fitted, and the scene box that their inputs are measured in.

`BrdfNetwork` gives base colour, roughness and metallic, `EmissionNetwork` the mask of pixels that
show an emitter, where that decides what emits; `Field` holds both with the box and answers in world coordinates. Sizes
are those of the paper's supplement.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.autograd.function import once_differentiable

from fipt.conventions import ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.model.hash_encoding import Backend, HashEncoding
from fipt.model.reflectance import Brdf
from fipt.model.settings import NetworkSettings
from fipt.render.variant import active_device

QUERY_CHUNK = 1 << 14
"""Points asked at once: few enough for their activations to stay in a processor's cache."""

_ON_ONE_THREAD = 1 << 12
"""Points whose outputs torch works on with one thread (fewer than its GRAIN_SIZE of 32,768 numbers)."""
_PART = 512
"""Points whose share of a gradient one thread sums."""
_FINEST_CELLS = 64
"""Cells along the box that know how fine the views are: some 10 cm in a room, a few pixels."""
_INITIAL_EMISSION = 0.05
_MASK = "emission_network."
_MATTE = (1.5, -3.0)
"""Logits of the first roughness and metallic (0.82 and 0.05) where the fit starts from matte."""


@dataclass(frozen=True)
class SceneBox:
    """The cube that every grid of the scene shares; sides parallel to the world's axes.

    Attributes
    ----------
    center : tuple of float
        World position, metres.
    side : float
        Length of a side, metres.
    """

    center: tuple[float, float, float]
    side: float

    def __post_init__(self) -> None:
        # Plain floats, so that boxes compare and become JSON whatever array they came from.
        object.__setattr__(self, "center", tuple(float(value) for value in self.center))
        object.__setattr__(self, "side", float(self.side))

    @classmethod
    def around(cls, points: np.ndarray, margin: float = 1.05) -> "SceneBox":
        """Box around points (N, 3), metres; its side is their longest extent times ``margin``."""
        lower, upper = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
        return cls((lower + upper) / 2, (upper - lower).max() * margin)

    def to_unit(self, points: Any) -> Any:
        """Map world points (..., 3), torch or numpy, to [0, 1] inside the box."""
        return (points - self._center_like(points)) / self.side + 0.5

    def to_signed(self, points: Any) -> Any:
        """Map world points (..., 3), torch or numpy, to [-1, 1] inside the box."""
        return (points - self._center_like(points)) / (0.5 * self.side)

    def _center_like(self, points: Any) -> Any:
        if isinstance(points, torch.Tensor):
            return points.new_tensor(self.center)
        return np.asarray(self.center, points.dtype)


class _Linear(nn.Linear):
    """A linear layer whose first weights `linear` draws, from a generator of its own.

    torch's `skip_init` would do as well, but imports sympy for it: most of a second at the start of every stage. The
    layer's gradients are the same to the bit with any number of threads.
    """

    def reset_parameters(self) -> None:
        """Draw nothing."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """Map (N, inputs) to (N, outputs)."""
        return _Product.apply(input, self.weight, self.bias)


class _Product(torch.autograd.Function):
    """The product of a linear layer.

    The gradient of a weight is a small matrix of long sums. A matrix library may divide these sums among
    its threads: the order of additions then depends on their number. Here the parts are fixed; one thread sums each.
    """

    @staticmethod
    def forward(ctx, x, weight, bias):
        ctx.save_for_backward(x, weight)
        return nn.functional.linear(x, weight, bias)

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient):
        x, weight = ctx.saved_tensors
        one, other = _in_parts(gradient), _in_parts(x)
        of_weight = torch.bmm(one.transpose(1, 2), other).sum(0)
        return gradient @ weight if ctx.needs_input_grad[0] else None, of_weight, gradient.sum(0)


def _in_parts(rows: torch.Tensor) -> torch.Tensor:
    """(N, K) as (parts, _PART, K), of few rows as two shorter parts; zeros fill the last.

    Two at least: a product that is alone would be divided.
    """
    part = max(min(_PART, -(-len(rows) // 2)), 1)
    missing = max(-len(rows) % part, 2 * part - len(rows))
    return (nn.functional.pad(rows, (0, 0, 0, missing)) if missing else rows).reshape(-1, part, rows.shape[1])


class _Sigmoid(nn.Module):
    """The sigmoid, the same to the bit with any number of threads.

    Torch cuts long arrays among its threads, and rounds otherwise where a part does not fill a vector.
    """

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Sigmoid of (N, 5)."""
        if len(x) <= _ON_ONE_THREAD:
            return x.sigmoid()
        return torch.cat([part.sigmoid() for part in x.split(_ON_ONE_THREAD)])


class PositionalMlp(nn.Module):
    """Positional encoding and an MLP, into whose middle the encoding enters again.

    Parameters
    ----------
    outputs : int
        Raw outputs.
    generator : torch.Generator
        Of the initial weights.
    bands, layers, width : int
        Frequency bands; hidden layers; their width.
    """

    frequencies: torch.Tensor

    def __init__(
        self, outputs: int, generator: torch.Generator, bands: int = 10, layers: int = 6, width: int = 128
    ) -> None:
        super().__init__()
        self.register_buffer("frequencies", math.pi * 2.0 ** torch.arange(bands), persistent=False)
        inputs = 3 + 6 * bands
        self.middle = layers // 2
        sizes = [inputs] + [width] * (layers - 1)
        sizes[self.middle] += inputs
        self.hidden = nn.ModuleList(linear(size, width, generator) for size in sizes)
        self.output = linear(width, outputs, generator)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Raw outputs (N, outputs) at points (N, 3) in [-1, 1]."""
        angles = (points[:, None, :] * self.frequencies[:, None]).flatten(1)
        encoded = torch.cat([points, angles.sin(), angles.cos()], dim=1)
        h = encoded
        for i, layer in enumerate(self.hidden):
            h = torch.relu(layer(torch.cat([encoded, h], dim=1) if i == self.middle else h))
        return self.output(h)


class BrdfNetwork(nn.Module):
    """Hash encoding and a small MLP, or positional encoding and a larger one: reflectance at points of the unit cube.

    Parameters
    ----------
    settings : NetworkSettings
        Sizes, start and seed.
    backend : {"auto", "drjit", "torch"}
        Of the encoding, see `HashEncoding`.
    """

    def __init__(self, settings: NetworkSettings, backend: Backend = "auto", width: int = 64) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(settings.seed + 1)
        self.encoding, self.whitest = None, settings.whitest
        if settings.encoding == "positional":
            positional = PositionalMlp(5, generator)
            self.mlp, last = nn.Sequential(positional, _Sigmoid()), positional.output
        else:
            self.encoding = HashEncoding(
                settings.levels,
                settings.table_log2,
                growth=settings.growth,
                seed=settings.seed,
                backend=backend,
            )
            inputs = settings.levels * self.encoding.features
            hidden = [linear(inputs, width, generator), nn.ReLU(), linear(width, width, generator), nn.ReLU()]
            last = linear(width, 5, generator)
            self.mlp = nn.Sequential(*hidden, last, _Sigmoid())
        if settings.start_rough:
            # matte metal and matte dielectric appear the same: start where most surfaces are
            with torch.no_grad():
                last.bias[3:] += torch.tensor(_MATTE)

    def forward(self, points: torch.Tensor, footprint: torch.Tensor | None = None) -> Brdf:
        """Reflectance at points (N, 3) in [0, 1], seen through footprints (N,) in box sides, which hash grids mind."""
        encoded = 2 * points - 1 if self.encoding is None else self.encoding(points, footprint)
        output = self.mlp(encoded)
        roughness, metallic = ROUGHNESS_MIN + (1 - ROUGHNESS_MIN) * output[:, 3], output[:, 4]
        white = torch.lerp(torch.full_like(metallic, self.whitest), torch.ones_like(metallic), metallic.detach())
        return Brdf(white[:, None] * output[:, :3], roughness, metallic)


class EmissionNetwork(PositionalMlp):
    """Positional encoding and an MLP: how much of a pixel is light of the surface's own.

    Parameters
    ----------
    seed : int
        Of the initial weights.
    bands, layers, width : int
        Frequency bands; hidden layers; their width.
    """

    def __init__(self, seed: int = 0, bands: int = 10, layers: int = 6, width: int = 128) -> None:
        super().__init__(1, torch.Generator().manual_seed(seed + 2), bands, layers, width)
        with torch.no_grad():
            # Everywhere slightly positive: a ReLU that starts shut would never open, and a mask
            # that starts wide open would explain the pixels away before the BRDF can.
            self.output.weight *= 0.1
            self.output.bias.fill_(_INITIAL_EMISSION)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Raw emission e (N,), before the ReLU, at points (N, 3) in [-1, 1]."""
        return super().forward(points)[:, 0]

    @staticmethod
    def mask(e: torch.Tensor) -> torch.Tensor:
        """Emission mask alpha in [0, 1) of raw emission: 1 - exp(-relu(e))."""
        return -torch.expm1(-torch.relu(e))


class Field(nn.Module):
    """Reflectance and emission everywhere in the scene, in world coordinates, on the device that traces rays.

    Parameters
    ----------
    settings : NetworkSettings
        Sizes, start and seed.
    box : SceneBox
        Where the scene is.
    backend : {"auto", "drjit", "torch"}
        Of the hash encoding.
    mask : bool
        Whether there is an emission network: it costs 40 % of a step, and only `emitters.decide: mask` asks it.
    inset : float
        Metres below a surface at which its reflectance lies (docs/adr/0095): so faces that meet in an edge, and the two
        sides of a sheet, do not share places.

    Attributes
    ----------
    settings, box, inset
        As given.
    finest
        (R, R, R) float32 width of the smallest query that taught anything in each cell of the box, metres; 0: none did.
    brdf_network : BrdfNetwork
    emission_network : EmissionNetwork or None
    """

    def __init__(
        self,
        settings: NetworkSettings,
        box: SceneBox,
        backend: Backend = "auto",
        *,
        mask: bool = False,
        inset: float = 0.0,
    ) -> None:
        super().__init__()
        self.settings, self.box, self.inset = settings, box, inset
        self.brdf_network = BrdfNetwork(settings, backend)
        self.emission_network = EmissionNetwork(settings.seed) if mask else None
        self.finest: torch.Tensor
        self.register_buffer("finest", torch.zeros((_FINEST_CELLS,) * 3))
        self.to(active_device())

    @property
    def device(self) -> torch.device:
        """Where it computes, and where tensors that it is asked about must be."""
        return self.finest.device

    def start_from(self, other: "Field") -> None:
        """Take over the weights of another field, but for a mask that only one of the two has.

        Raises
        ------
        FiptError
            If its networks have other sizes.
        """
        own, given = self.state_dict(), other.state_dict()
        weights = {name: tensor for name, tensor in own.items() if name.startswith(_MASK)}
        weights |= {name: tensor for name, tensor in given.items() if name in own or not name.startswith(_MASK)}
        if {name: value.shape for name, value in weights.items()} != {name: value.shape for name, value in own.items()}:
            raise FiptError(
                "the model of the round before must have networks of the same sizes; it has others",
                "fit all rounds with the same settings",
            )
        self.load_state_dict(weights)

    def learn_finest(self, points: np.ndarray, footprint: np.ndarray) -> None:
        """Take note of queries at points (N, 3) of width ``footprint`` (N,), metres, that teach the field."""
        known = torch.where(self.finest > 0, self.finest, torch.inf).view(-1)
        known.scatter_reduce_(0, self._cells(points), self._tensor(footprint), "amin")
        self.finest.copy_(torch.where(known < torch.inf, known, 0.0).view_as(self.finest))

    def finest_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) float32 width of the smallest query that taught anything around points (N, 3), metres; 0: none did."""
        return self.finest.view(-1)[self._cells(points)].cpu().numpy()

    def _cells(self, points: np.ndarray) -> torch.Tensor:
        """(N,) int64 cell of `finest` of points (N, 3)."""
        cell = (self.box.to_unit(self._tensor(points)) * _FINEST_CELLS).long().clamp(0, _FINEST_CELLS - 1)
        return (cell[:, 0] * _FINEST_CELLS + cell[:, 1]) * _FINEST_CELLS + cell[:, 2]

    def place(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N, 3) where the reflectance of surface at points (N, 3), metres, with normals (N, 3) to its viewer lies."""
        return np.asarray(points) - np.float32(self.inset) * np.asarray(normals)

    def brdf(self, p_world: torch.Tensor, footprint: torch.Tensor | None = None) -> Brdf:
        """Reflectance at places of the world.

        Parameters
        ----------
        p_world : torch.Tensor
            (N, 3) float32, metres, as `place` gives them.
        footprint : torch.Tensor, optional
            (N,) float32, metres: size of the patch that is asked for; finer detail is faded out.
        """
        footprint = None if footprint is None else footprint / self.box.side
        return self.brdf_network(self.box.to_unit(p_world), footprint)

    def emission(self, p_world: torch.Tensor) -> torch.Tensor | None:
        """Raw emission e (N,) at world points (N, 3), metres; None without an emission network."""
        return None if self.emission_network is None else self.emission_network(self.box.to_signed(p_world))

    def query(
        self,
        points: np.ndarray,
        footprint: np.ndarray | None = None,
        triangle: np.ndarray | None = None,
        chunk: int = QUERY_CHUNK,
    ) -> Brdf:
        """Reflectance at any number of places of the world, without gradients.

        Parameters
        ----------
        points : numpy.ndarray
            (N, 3), metres, as `place` gives them.
        footprint : numpy.ndarray, optional
            (N,), metres.
        triangle : numpy.ndarray, optional
            (N,) triangles of the points; a field has no use for them.
        chunk : int
            Points computed at once.

        Returns
        -------
        Brdf
            Of numpy arrays, float32.
        """
        outputs = np.empty((len(points), 5), np.float32)

        def ask(part: slice) -> None:
            brdf = self.brdf(
                self._tensor(points[part]),
                None if footprint is None else self._tensor(footprint[part]),
            )
            columns = (brdf.base_color, brdf.roughness[:, None], brdf.metallic[:, None])
            outputs[part] = torch.cat(columns, dim=1).cpu().numpy()

        _chunked(ask, len(points), chunk)
        return Brdf(outputs[:, :3].copy(), outputs[:, 3].copy(), outputs[:, 4].copy())

    def query_mask(self, points: np.ndarray, chunk: int = QUERY_CHUNK) -> np.ndarray:
        """Emission mask (N,) float32 at any number of world points (N, 3), without gradients.

        Raises
        ------
        FiptError
            If the model has none.
        """
        mask = np.empty(len(points), np.float32)

        def ask(part: slice) -> None:
            e = self.emission(self._tensor(points[part]))
            if e is None:
                raise FiptError(
                    "the model must have an emission mask; it has none",
                    "fit it without --emitters, or set emitters.decide: regions",
                )
            mask[part] = EmissionNetwork.mask(e).cpu().numpy()

        _chunked(ask, len(points), chunk)
        return mask

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        # A copy: arrays of the pipeline are often read-only memory maps, which torch cannot share.
        return torch.tensor(np.asarray(array, np.float32), device=self.device)


@torch.no_grad()
def _chunked(ask: Callable[[slice], None], count: int, chunk: int) -> None:
    for start in range(0, count, chunk):
        ask(slice(start, min(start + chunk, count)))


def linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """Linear layer with torch's usual initial weights, but from a generator of our own."""
    layer = _Linear(inputs, outputs)
    bound = 1 / math.sqrt(inputs)
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound, generator=generator)
        layer.bias.uniform_(-bound, bound, generator=generator)
    return layer
