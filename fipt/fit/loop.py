"""The optimisation: plain, seeded, resumable."""

import math
from pathlib import Path

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.fit.batches import Batch, Pixels
from fipt.fit.losses import (
    gathered,
    part_propagation,
    reflected,
    semantic_propagation,
    srgb,
)
from fipt.io.manifests import Stats
from fipt.model.networks import Field
from fipt.model.store import load_checkpoint, save_checkpoint
from fipt.progress import progress
from fipt.settings import Fit


def losses(
    field: Field, batch: Batch, kind: str | None, settings: Fit, targets: torch.Tensor | None = None
) -> dict[str, torch.Tensor]:
    """All loss terms of a batch, weighted; ``colour`` is the data term.

    Parameters
    ----------
    kind
        What the segment ids mean: ``part``, ``semantic`` or None.
    targets
        (S, 3) roughness and metallic that each segment is drawn to, and the weight; None: matte, as the paper.
    """
    count, queries = batch.points.shape[:2]
    footprint = (batch.footprint * settings.footprint)[:, None].expand(-1, queries).reshape(-1)
    brdf = field.brdf(batch.points.view(-1, 3), footprint)
    radiance, specular = reflected(brdf, batch.shading, queries)
    e = field.emission(batch.points[:, 0])
    alpha = field.emission_network.mask(e)[:, None]
    seen = batch.radiance[batch.owner]
    # a lamp's pixel says nothing about reflectance, nor does a clipped one: only the mask learns from them
    silent = batch.clipped[batch.owner]
    if settings.evidence > 0:
        silent = silent | evident_emitters(batch, settings.evidence)
    radiance = torch.where(silent[:, None], radiance.detach(), radiance)
    pixel = gathered((1 - alpha) * radiance + alpha * seen, batch.owner, batch.weight, len(batch.radiance))
    difference = srgb(pixel) - srgb(batch.radiance)
    # what is brighter than a lower bound agrees with it
    difference = torch.where(batch.clipped[:, None], difference.clamp(max=0.0), difference)
    error = difference.square().mean(1)
    s, m = brdf.roughness.view(count, queries).mean(1), brdf.metallic.view(count, queries).mean(1)
    terms = {
        "colour": settings.colour_weight * (batch.valid * error).mean(),
        "emission": settings.emission_weight * e.abs().mean(),
    }
    if targets is None:
        terms["diffuse"] = settings.diffuse_weight * ((1 - s).mean() + m.mean())
    else:
        goal_s, goal_m, price = targets[batch.segment].unbind(1)
        terms["target"] = (price * (_apart(s, goal_s) + _apart(m, goal_m))).mean()
    if kind == "part":
        terms["part"] = settings.part_weight * part_propagation(s, m, specular, batch.segment)
    elif kind == "semantic":
        terms["semantic"] = settings.semantic_weight * semantic_propagation(
            s,
            m,
            brdf.base_color.view(count, queries, 3).mean(1),
            field.box.to_signed(batch.points[:, 0]),
            batch.segment,
        )
    return terms


def _apart(value: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
    """Distance (H,) of logits: it pulls as hard where a sigmoid has saturated; goals keep off its ends."""
    value, goal = (x.clamp(low, 1 - low) for x, low in ((value, 1e-4), (goal, 0.004)))
    return (torch.logit(value) - torch.logit(goal)).abs()


def evident_emitters(batch: Batch, gain: float) -> torch.Tensor:
    """(H,) bool: hits that are ``gain`` times brighter than a white surface or a mirror would be there."""
    levels = (batch.shading.shape[1] - 1) // 2
    mirror = (batch.shading[:, 1 : 1 + levels] + batch.shading[:, 1 + levels :]).amax(1)
    most = torch.maximum(batch.shading[:, 0], mirror).mean(1)
    return batch.radiance.mean(1)[batch.owner] > gain * (most + 1e-4)


def fit(
    field: Field,
    pixels: Pixels,
    kind: str | None,
    settings: Fit,
    checkpoint: Path,
    stats: Stats,
    targets: torch.Tensor | None = None,
) -> None:
    """Optimise ``field`` in place; go on from ``checkpoint`` where there is one.

    Raises
    ------
    FiptError
        If the loss is not finite, or the checkpoint belongs to another version or other settings.
    """
    steps = max(settings.steps, math.ceil(settings.min_epochs * len(pixels) / settings.batch))
    optimizer = torch.optim.Adam(_parameter_groups(field, settings), fused=True)
    done = 0
    if checkpoint.exists():
        done, _ = load_checkpoint(checkpoint, field, optimizer, settings)
        print(f"fit: going on from step {done}")
    decay = (settings.final_learning_rate / settings.learning_rate) ** (1 / max(steps, 1))
    order, epoch_now = np.empty(0, np.int64), -1
    per_epoch = max(len(pixels) // settings.batch, 1)
    curve: list[list[float]] = []
    with progress("fit", steps - done, " steps") as bar:
        for step in range(done, steps):
            for group in optimizer.param_groups:
                group["lr"] = group["first_lr"] * decay**step
            epoch, position = divmod(step, per_epoch)
            if epoch != epoch_now:
                order, epoch_now = pixels.epoch_order(epoch, settings.seed), epoch
            chosen = order[position * settings.batch : (position + 1) * settings.batch]
            # keyed by step, so that a resumed fit draws what an uninterrupted one would
            rng = np.random.default_rng([settings.seed, 1, step])
            terms = losses(field, pixels.batch(chosen, settings.queries, rng), kind, settings, targets)
            loss = sum(terms.values())
            if not torch.isfinite(loss):
                wrong = ", ".join(name for name, term in terms.items() if not term.isfinite())
                raise FiptError(
                    f"the loss is not finite at step {step} ({wrong})",
                    "look for extreme radiance in the images, or lower fit.learning_rate",
                )
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            colour = float(terms["colour"].detach())
            if step % max(steps // 100, 1) == 0:
                curve.append([step, colour])
            bar.advance(1, f"colour loss {colour:.5f}")
            if (step + 1) % settings.checkpoint_every == 0 and step + 1 < steps:
                save_checkpoint(checkpoint, field, optimizer, settings, step + 1)
        stats["steps_per_s"] = bar.rate
    stats["steps"] = steps
    stats["pixels"] = len(pixels)
    stats["loss"] = {name: float(term.detach()) for name, term in terms.items()} if steps > done else {}
    stats["loss_curve"] = curve


def _parameter_groups(field: Field, settings: Fit) -> list[dict]:
    """The hash table learns faster than the networks: an entry is touched in few of the steps."""
    table = field.brdf_network.encoding.table
    others = [p for p in field.parameters() if p is not table]
    rate, fast = settings.learning_rate, settings.learning_rate * settings.table_rate
    return [{"params": [table], "lr": fast, "first_lr": fast}, {"params": others, "lr": rate, "first_lr": rate}]
