"""One training step of the networks: Dr.Jit kernels against the plain-torch twin, both with fused Adam.

A step is what the fit does without its losses: 8,192 material queries and, with the paper's sizes, 2,048 emission
queries, forward and backward through the networks, one step of Adam on all parameters.
"""

from collections.abc import Callable
from functools import partial

import torch

from benchmarks.timing import added_memory, in_turns
from fipt.model.networks import Field, SceneBox
from fipt.stages.fit.settings import FitSettings

MATERIAL_QUERIES = 8192
EMISSION_QUERIES = 2048
PAPER = FitSettings(levels=32, table_log2=19, growth=1.3)
"""Sizes of the published networks; the defaults of `Fit` are this program's."""


def stepper(settings: FitSettings, backend: str, device: str) -> Callable[[], None]:
    """Return a function that runs one step and waits for its end."""
    field = Field(settings, SceneBox((0.0, 0.0, 0.0), 8.0), backend, mask=settings is PAPER).to(device)
    optimizer = torch.optim.Adam(field.parameters(), lr=1e-3, fused=True)
    generator = torch.Generator().manual_seed(0)

    def step() -> None:
        points = (torch.rand(MATERIAL_QUERIES, 3, generator=generator) * 8 - 4).to(device)
        footprint = (torch.rand(MATERIAL_QUERIES, generator=generator) * 0.02).to(device)
        brdf = field.brdf(points, footprint)
        e = field.emission(points[:EMISSION_QUERIES]) if settings is PAPER else torch.zeros(1)
        target = points.sin().abs()
        loss = (brdf.kd + brdf.ks * brdf.roughness[:, None] - target).square().mean()
        loss = loss + e.abs().mean().to(device) + brdf.metallic.mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        if device == "cuda":
            torch.cuda.synchronize()

    return step


def step_times(settings: FitSettings, device: str, repeats: int) -> dict[str, list[float]]:
    """Seconds of steps with ``drjit`` kernels and with the ``torch`` twin, taken in turns."""
    steppers = {backend: stepper(settings, backend, device) for backend in ("drjit", "torch")}
    times = in_turns(steppers, repeats + 2)
    # kernels compile and memory pools fill in the first ones
    return {backend: seconds[2:] for backend, seconds in times.items()}


def step_memory(settings: FitSettings, device: str) -> dict[str, float | None]:
    """Megabytes of networks, optimiser and two steps."""

    def two_steps(backend: str) -> None:
        step = stepper(settings, backend, device)
        for _ in range(2):
            step()

    return {backend: added_memory(partial(two_steps, backend)) for backend in ("drjit", "torch")}
