"""Whether the networks have come to what the search of parts found: after too few steps metals are half paint."""

import numpy as np
import torch

from fipt.model.networks import Field
from fipt.stages.fit.batches import Pixels

_PIXELS = 20_000
"""Pixels that are looked at, at most."""

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
    chosen = np.arange(0, len(pixels), -(-len(pixels) // _PIXELS))
    batch = pixels.batch(chosen, 1, np.random.default_rng(0))
    with torch.no_grad():
        fitted = field.brdf(batch.points[:, 0], batch.footprint * footprint).metallic
    goal = torch.from_numpy(metallic.astype(np.float32))[batch.segment]
    off = ((fitted - goal).abs() > _OFF) & (batch.segment > 0)
    return float(batch.weight[off].sum() / len(chosen))


def said_of(missed: float) -> list[str]:
    """A warning where the share of `metallic_missed` is more than that of fits that have converged."""
    if missed < _MANY:
        return []
    return [
        f"in {missed:.1%} of the pixels the networks have not come to what is metal and what is not by the search of "
        "parts; base colours are wrong there; more fit.steps help, and more rounds"
    ]
