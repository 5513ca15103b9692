"""The optimisation of the field."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.mesh_settings import VolumeGeometry
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.losses import VolumeLoss
from fipt.stages.geometry.volume.pixels import BYTES_A_PIXEL, VolumePixels
from fipt.stages.geometry.volume.rendering import Rays, render

_DECAY = 0.25
"""Of the learning rates, over all steps."""
_WIDTH_RATE = 10.0
"""Learning rate of the density's width over the networks': it is a share of the first one."""

Sampler = Callable[[VolumeField, Rays, float, np.ndarray, torch.Generator], torch.Tensor]
"""Places (R, S) along rays: from field, rays, step, numbers of their pixels, random numbers."""


def check_volume_memory(settings: VolumeGeometry, samples: int, views: Sequence[DepthView]) -> None:
    """Refuse a step that would need more than ``geometry.memory_gb``, before it starts."""
    places = settings.rays * samples
    inputs = 2 * settings.levels + 40
    # four places a sample, with what their gradients need; then radiance
    numbers = places * (4 * (2 * inputs + 5 * settings.width) + 6 * settings.width + 100)
    table = settings.levels * 2 * 2**settings.table_log2
    needed = (4 * (numbers + 4 * table) + BYTES_A_PIXEL * sum(view.map.depth.size for view in views)) / 1e9 + 1.0
    if needed > settings.memory_gb:
        raise FiptError(
            f"a step of {settings.rays} rays with {samples} samples needs about {needed:.1f} GB; geometry.memory_gb is "
            f"{settings.memory_gb:g}",
            "lower geometry.rays or geometry.samples, or raise geometry.memory_gb",
        )


def fit_field(
    field: VolumeField,
    pixels: VolumePixels,
    sampler: Sampler,
    settings: VolumeGeometry,
    step_at: Callable[[float], float],
    frozen: float = 0.0,
) -> dict[str, Any]:
    """Optimise the field in place.

    Parameters
    ----------
    step_at
        Half sides between places that tell a gradient, by the share of the steps done.
    frozen
        Share of the steps, the first ones, in which only radiance is learned.

    Returns
    -------
    dict
        Figures: the last step's loss, term by term, and the width of the density.

    Raises
    ------
    FiptError
        If the loss is not finite.
    """
    rng, generator = np.random.default_rng(settings.seed), torch.Generator().manual_seed(settings.seed)
    optimizer = torch.optim.Adam(_groups(field, settings), betas=(0.9, 0.99), eps=1e-15)
    rates = [group["lr"] for group in optimizer.param_groups]
    loss, terms, done = VolumeLoss(settings), {}, 0.0
    with progress("signed distance", settings.iterations, " steps") as bar:
        for number in range(settings.iterations):
            done = number / settings.iterations
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = rate * _DECAY**done
            chosen = pixels.draw(settings.rays, rng)
            batch, step = pixels.batch(chosen, field.device), step_at(done)
            t = sampler(field, batch.rays, step, chosen, generator)
            field.learns_distance = done >= frozen
            seen = render(field, batch.rays, t, step)
            offsets = 2 * torch.rand(len(batch.rays), 3, generator=generator).to(field.device) - 1
            terms = loss.terms(field, batch, seen, step, offsets)
            optimizer.zero_grad(set_to_none=True)
            _finite_sum(terms, number).backward()
            optimizer.step()
            field.density.bound()
            bar.advance(1, f"colour loss {float(terms['color'].detach()):.4f}")
    figures: dict[str, Any] = {name: round(float(term.detach()), 6) for name, term in terms.items()}
    return {"loss": figures, "beta": round(float(field.density.beta.detach()), 6), "steps_per_s": round(bar.rate, 2)}


def _finite_sum(terms: dict[str, torch.Tensor], number: int) -> torch.Tensor:
    """Sum of the terms; a FiptError names those that are not finite."""
    total = sum(terms.values(), torch.zeros((), device=terms["color"].device))
    if not torch.isfinite(total):
        wrong = ", ".join(name for name, term in terms.items() if not term.isfinite())
        raise FiptError(
            f"the loss of the signed distance must be finite; it is not at step {number} ({wrong})",
            "look for extreme radiance in the images, or lower geometry.learning_rate",
        )
    return total


def _groups(field: VolumeField, settings: VolumeGeometry) -> list[dict[str, Any]]:
    """Parameters with their learning rates: entries of a grid are touched in few of the steps."""
    networks = [*field.distance_network.parameters(), *field.radiance_network.parameters()]
    rate = settings.learning_rate
    return [
        {"params": [field.encoding.table], "lr": rate * settings.table_rate},
        {"params": networks, "lr": rate},
        {"params": [field.density.scale], "lr": rate * _WIDTH_RATE},
    ]
