"""Materials as the fit represents them, a hash encoding and a small network, but by gradients of path tracing."""

from collections.abc import Mapping

import numpy as np
import torch

from fipt.model.networks import Field
from fipt.model.reflectance import Brdf
from fipt.stages.inverse_trace.optimise import PartOptimiser
from fipt.stages.inverse_trace.settings import InverseTraceSettings

_TABLE_RATE = 8.0
"""Learning rate of the hash table over the network's, as in the fit."""


class FieldOptimiser(PartOptimiser):
    """Materials of N texels are what a field says at their places; emission is that of groups.

    Parameters
    ----------
    field
        What is optimised, in place.
    place
        (N, 3) float32 metres.
    size
        Metres along the side of a texel.
    count
        Groups.
    level
        Median radiance of the pixels.
    """

    def __init__(self, field: Field, place: np.ndarray, size: float, count: int, level: float) -> None:
        self._field, self._place = field, torch.tensor(np.array(place, np.float32), device=field.device)
        self._size = torch.full((len(place),), size * field.settings.footprint, device=field.device)
        encoding, mlp = field.brdf_network.encoding, field.brdf_network.mlp
        tables = [] if encoding is None else [encoding.table]
        self._rates = {_TABLE_RATE: tables, 1.0: list(mlp.parameters())}
        self._optimizer = torch.optim.Adam([{"params": each} for each in self._rates.values()])
        self._found: Brdf | None = None
        super().__init__(count, level)

    def _start(self, count: int, level: float) -> dict[str, np.ndarray]:
        return {"emission": super()._start(count, level)["emission"]}

    def _asked(self) -> Brdf:
        """What the field says now, with its gradient."""
        if self._found is None:
            self._found = self._field.brdf(self._place, self._size)
        return self._found

    def _materials(self) -> dict[str, np.ndarray]:
        return {name: values.detach().cpu().numpy() for name, values in vars(self._asked()).items()}

    def step(self, gradient: Mapping[str, np.ndarray], settings: InverseTraceSettings, done: float) -> None:
        """One step, by the gradient with respect to `values`; ``done`` is the share of steps that are done."""
        found = vars(self._asked())
        torch.autograd.backward(
            list(found.values()),
            [torch.tensor(np.array(gradient[name], np.float32), device=self._field.device) for name in found],
        )
        for rate, group in zip(self._rates, self._optimizer.param_groups, strict=True):
            group["lr"] = rate * settings.learning_rate * self.fading(done)
        self._optimizer.step()
        self._optimizer.zero_grad()
        super().step({"emission": gradient["emission"]}, settings, done)
        self._found = None  # the network is another one now
