"""The optimisation: plain, seeded, resumable."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.formats.manifests import Stats
from fipt.model.networks import Brdf, Field
from fipt.model.store import load_checkpoint, save_checkpoint
from fipt.progress import progress
from fipt.stages.fit.batches import Batch, Pixels, shuffled
from fipt.stages.fit.hidden import Hidden
from fipt.stages.fit.losses import (
    apart,
    gathered,
    part_propagation,
    reflected,
    semantic_propagation,
    srgb,
)
from fipt.stages.fit.parts import PartTargets
from fipt.stages.fit.settings import FitSettings

_MASKED = 0.1
"""Emission mask above which a surface counts as a lamp while the fit goes on."""


def losses(
    field: Field,
    batch: Batch,
    kind: str | None,
    settings: FitSettings,
    targets: PartTargets | None = None,
    hidden: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None,
) -> dict[str, torch.Tensor]:
    """All loss terms of a batch, weighted; ``colour`` is the data term.

    Parameters
    ----------
    kind
        What the segment ids mean: ``part``, ``semantic`` or None.
    targets
        What each segment is drawn to; None: all to matte, as the paper.
    hidden
        Points (N, 3), segments (N,) and sizes (N,) of surface that no view sees, drawn to what its segment is drawn to.
    """
    count, queries = batch.points.shape[:2]
    footprint = (batch.footprint * settings.footprint)[:, None].expand(-1, queries).reshape(-1)
    brdf = field.brdf(batch.points.view(-1, 3), footprint)
    own = None if targets is None else targets.of(batch.segment)
    shown = _sure(brdf, own, queries) if own is not None and settings.base_weight > 0 else brdf
    radiance, specular = reflected(shown, batch.shading, queries)
    e = field.emission(batch.points[:, 0])
    alpha = field.emission_network.mask(e)[:, None]
    seen = batch.on_mesh[batch.owner]
    # a pixel that shows a lamp, if only in part, says nothing about reflectance, nor does a clipped one: only the mask
    # learns from them
    silent = batch.clipped[batch.owner]
    if settings.evidence > 0:
        silent = silent | _show_lamps(batch, alpha[:, 0].detach(), settings.evidence)
    radiance = torch.where(silent[:, None], radiance.detach(), radiance)
    pixel = gathered((1 - alpha) * radiance + alpha * seen, batch.owner, batch.weight, len(batch.radiance))
    if batch.beyond is not None:
        pixel = pixel + batch.beyond
    difference = srgb(pixel) - srgb(batch.radiance)
    # what is brighter than a lower bound agrees with it
    difference = torch.where(batch.clipped[:, None], difference.clamp(max=0.0), difference)
    error = difference.square().mean(1)
    s, m = brdf.roughness.view(count, queries).mean(1), brdf.metallic.view(count, queries).mean(1)
    terms = {
        "colour": settings.colour_weight * (batch.valid * error).mean(),
        "emission": settings.emission_weight * e.abs().mean(),
    }
    if own is None:
        terms["diffuse"] = settings.diffuse_weight * ((1 - s).mean() + m.mean())
    else:
        doubt = 1.5 - batch.confidence if settings.confidence else 1.0  # what pictures do not tell, the part does
        terms["target"] = (doubt * _pull(s, m, own)).mean()
        terms["base"] = settings.base_weight * (own.uniform * _off(brdf.base_color, own, queries)).mean()
    if own is not None and hidden is not None:
        points, segment, size = hidden
        goal, there = targets.of(segment), field.brdf(points, size)
        base = settings.base_weight * goal.uniform.clamp_min(1) * _off(there.base_color, goal, 1)
        # as many samples would weigh
        terms["hidden"] = (base + _pull(there.roughness, there.metallic, goal)).sum() / count
    if kind == "part":
        terms["part"] = settings.part_weight * part_propagation(s, m, specular * batch.confidence, batch.segment)
    elif kind == "semantic":
        terms["semantic"] = settings.semantic_weight * semantic_propagation(
            s,
            m,
            brdf.base_color.view(count, queries, 3).mean(1),
            field.box.to_signed(batch.points[:, 0]),
            batch.segment,
        )
    return terms


def _sure(brdf: Brdf, own: PartTargets, queries: int) -> Brdf:
    """The same reflectance; pictures teach the base colour of a part the less, the rather it has but one."""
    share = (own.uniform / (1 + own.uniform)).repeat_interleave(queries)[:, None]
    return replace(brdf, base_color=torch.lerp(brdf.base_color, brdf.base_color.detach(), share))


def _pull(s: torch.Tensor, m: torch.Tensor, own: PartTargets) -> torch.Tensor:
    """(N,) weighted distance of roughness and metallic (N,) from those of their parts."""
    return own.pull * (apart(s, own.roughness) + apart(m, own.metallic))


def _off(base_color: torch.Tensor, own: PartTargets, queries: int) -> torch.Tensor:
    """(N,) mean square difference of base colours (N * queries, 3) and those of their parts."""
    return (base_color.view(-1, queries, 3) - own.base_color[:, None]).square().mean((1, 2))


def _show_lamps(batch: Batch, alpha: torch.Tensor, gain: float) -> torch.Tensor:
    """(H,) bool: samples in pixels that show a lamp, by their brightness or by the mask (H,), if only in part."""
    lamp = evident_emitters(batch, gain) | (alpha > _MASKED)
    pixel = torch.zeros(len(batch.radiance), dtype=torch.bool, device=lamp.device)
    pixel[batch.owner[lamp]] = True
    return pixel[batch.owner]


def evident_emitters(batch: Batch, gain: float) -> torch.Tensor:
    """(H,) bool: samples that are ``gain`` times brighter than a white surface or a mirror would be there."""
    levels = (batch.shading.shape[1] - 1) // 2
    mirror = (batch.shading[:, 1 : 1 + levels] + batch.shading[:, 1 + levels :]).amax(1)
    most = torch.maximum(batch.shading[:, 0], mirror).mean(1)
    return batch.on_mesh.mean(1)[batch.owner] > gain * (most + 1e-4)


def fit(
    field: Field,
    pixels: Pixels,
    kind: str | None,
    settings: FitSettings,
    checkpoint: Path,
    stats: Stats,
    targets: PartTargets | None = None,
    hidden: Hidden | None = None,
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
        done = load_checkpoint(checkpoint, field, optimizer, settings)
        print(f"fit: going on from step {done}")
    decay = (settings.final_learning_rate / settings.learning_rate) ** (1 / max(steps, 1))
    per_epoch = max(len(pixels) // settings.batch, 1)
    curve: list[list[float]] = []
    with progress("fit", steps - done, " steps") as bar:
        for step in range(done, steps):
            for group in optimizer.param_groups:
                group["lr"] = group["first_lr"] * decay**step
            epoch, position = divmod(step, per_epoch)
            first = position * settings.batch
            places = np.arange(first, min(first + settings.batch, len(pixels)))
            chosen = shuffled(places, len(pixels), [settings.seed, epoch])
            # keyed by step, so that a resumed fit draws what an uninterrupted one would
            rng = np.random.default_rng([settings.seed, 1, step])
            batch = pixels.batch(chosen, settings.queries, rng)
            unseen = hidden.drawn(settings.hidden, rng) if hidden is not None else None
            terms = losses(field, batch, kind, settings, targets, unseen)
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


def _parameter_groups(field: Field, settings: FitSettings) -> list[dict]:
    """The hash table learns faster than the networks: an entry is touched in few of the steps."""
    table = field.brdf_network.encoding.table
    others = [p for p in field.parameters() if p is not table]
    rate, fast = settings.learning_rate, settings.learning_rate * settings.table_rate
    return [{"params": [table], "lr": fast, "first_lr": fast}, {"params": others, "lr": rate, "first_lr": rate}]
