"""The optimisation: plain, seeded, resumable."""

import logging
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.formats.manifests import Stats
from fipt.model.networks import Field
from fipt.model.store import load_checkpoint, save_checkpoint
from fipt.progress import progress
from fipt.stages.fit.batches import Batch, Pixels, shuffled
from fipt.stages.fit.hidden import HiddenSurface
from fipt.stages.fit.objective import HiddenPoints, Objective
from fipt.stages.fit.settings import FitSettings

log = logging.getLogger(__name__)


def fit(
    field: Field, pixels: Pixels, objective: Objective, checkpoint: Path, hidden: HiddenSurface | None = None
) -> Stats:
    """Optimise ``field`` in place; go on from ``checkpoint`` where there is one. Return the figures of the fit.

    Raises
    ------
    FiptError
        If the loss is not finite, or the checkpoint belongs to another version or other settings.
    """
    settings = objective.settings
    steps = max(settings.steps, math.ceil(settings.min_epochs * len(pixels) / settings.batch))
    optimizer = torch.optim.Adam(_parameter_groups(field, settings), fused=True)
    done = 0
    if checkpoint.exists():
        done = load_checkpoint(checkpoint, field, optimizer, settings)
        log.info("fit: going on from step %d", done)
    decay = (settings.final_learning_rate / settings.learning_rate) ** (1 / max(steps, 1))
    curve: list[list[float]] = []
    terms: dict[str, torch.Tensor] = {}
    with _sums_in_order(field.device), progress("fit", steps - done, " steps") as bar, ThreadPoolExecutor(1) as ahead:
        # The batch of a step is put together while the one before is computed.
        coming = ahead.submit(_drawn, pixels, hidden, settings, done, field.device)
        for step in range(done, steps):
            for group in optimizer.param_groups:
                group["lr"] = group["first_lr"] * decay**step
            batch, points = coming.result()
            coming = ahead.submit(_drawn, pixels, hidden, settings, step + 1, field.device)
            terms = objective.terms(field, batch, points)
            optimizer.zero_grad(set_to_none=True)
            _finite_sum(terms, step).backward()
            optimizer.step()
            color = float(terms["color"].detach())
            if step % max(steps // 100, 1) == 0:
                curve.append([step, color])
            bar.advance(1, f"colour loss {color:.5f}")
            if (step + 1) % settings.checkpoint_every == 0 and step + 1 < steps:
                save_checkpoint(checkpoint, field, optimizer, settings, step + 1)
    return {
        "steps_per_s": bar.rate,
        "steps": steps,
        "pixels": len(pixels),
        "loss": {name: float(term.detach()) for name, term in terms.items()},
        "loss_curve": curve,
    }


@contextmanager
def _sums_in_order(device: torch.device) -> Iterator[None]:
    """Sums of torch on a GPU repeat to the bit meanwhile, as those on a CPU do anyway."""
    before = torch.are_deterministic_algorithms_enabled()
    torch.use_deterministic_algorithms(before or device.type == "cuda")
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before)


def _drawn(
    pixels: Pixels, hidden: HiddenSurface | None, settings: FitSettings, step: int, device: torch.device
) -> tuple[Batch, HiddenPoints | None]:
    """Pixels and points of a step, keyed by it: a resumed fit draws what an uninterrupted one would."""
    epoch, position = divmod(step, max(len(pixels) // settings.batch, 1))
    first = position * settings.batch
    places = np.arange(first, min(first + settings.batch, len(pixels)))
    chosen = shuffled(places, len(pixels), [settings.seed, epoch])
    rng = np.random.default_rng([settings.seed, 1, step])
    batch = pixels.batch(chosen, settings.queries, rng).to(device)
    if hidden is None:
        return batch, None
    points, segment, size = hidden.drawn(settings.hidden, rng)
    return batch, (points.to(device), segment.to(device), size.to(device))


def _finite_sum(terms: dict[str, torch.Tensor], step: int) -> torch.Tensor:
    """Sum of the terms; a FiptError names those that are not finite."""
    loss = sum(terms.values(), torch.zeros(()))
    if not torch.isfinite(loss):
        wrong = ", ".join(name for name, term in terms.items() if not term.isfinite())
        raise FiptError(
            f"the loss is not finite at step {step} ({wrong})",
            "look for extreme radiance in the images, or lower fit.learning_rate",
        )
    return loss


def _parameter_groups(field: Field, settings: FitSettings) -> list[dict[str, Any]]:
    """The hash table learns faster than the networks: an entry is touched in few of the steps."""
    encoding = field.brdf_network.encoding
    tables = [] if encoding is None else [encoding.table]
    others = [p for p in field.parameters() if not any(p is table for table in tables)]
    rate, fast = settings.learning_rate, settings.learning_rate * settings.table_rate
    groups = [{"params": tables, "lr": fast, "first_lr": fast}] if tables else []
    return [*groups, {"params": others, "lr": rate, "first_lr": rate}]
