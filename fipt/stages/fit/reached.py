"""Whether the networks have come to what the search of parts found: after too few steps metals are half paint."""

import numpy as np
import torch

from fipt.model.networks import Field
from fipt.scene.samples import scattered
from fipt.stages.fit.batches import Pixels

_PIXELS, _TOGETHER = 20_000, 1000
"""Pixels that are looked at, at most, and those that are in memory at a time (7,300 B each)."""

_OFF = 0.3
"""Difference of metallic from that of the part."""

_MANY = 0.005
"""Share of the pixels from which on it is said.

Rounds of three rooms, with and without scan, have up to 0.0033; a fit that lost 5 dB of kd by it has 0.020."""


def metallic_missed(field: Field, pixels: Pixels, metallic: np.ndarray, footprint: float) -> float:
    """Share of the training pixels whose fitted metallic is far from that of their part.

    Parameters
    ----------
    metallic
        (S,) what the search found for every segment.
    footprint
        Share of a pixel that the networks are asked about (settings of the fit).
    """
    goal = torch.from_numpy(metallic.astype(np.float32)).to(field.device)
    chosen, missed = scattered(0, len(pixels), -(-len(pixels) // _PIXELS)), 0.0
    for first in range(0, len(chosen), _TOGETHER):
        batch = pixels.batch(chosen[first : first + _TOGETHER], 1, np.random.default_rng(0)).to(field.device)
        with torch.no_grad():
            fitted = field.brdf(batch.points[:, 0], batch.footprint * footprint).metallic
        off = ((fitted - goal[batch.segment]).abs() > _OFF) & (batch.segment > 0)
        missed += float(batch.weight[off].sum())
    return missed / len(chosen)


def said_of(missed: float) -> list[str]:
    """A warning where the share of `metallic_missed` is more than that of fits that have converged."""
    if missed < _MANY:
        return []
    return [
        f"in {missed:.1%} of the pixels the networks have not come to what is metal and what is not by the search of "
        "parts; base colours are wrong there; more fit.steps help, and more rounds"
    ]
