"""The price of the emission mask: it may explain a pixel away, but not for nothing.

L = mean over samples of |e|

e    raw emission, before the ReLU of alpha = 1 - exp(-relu(e))
"""

import torch


def emission_term(emission: torch.Tensor) -> torch.Tensor:
    """L of raw emission (H,)."""
    return emission.abs().mean()
