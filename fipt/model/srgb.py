"""The sRGB curve of tensors, for losses."""

import torch


def srgb(linear: torch.Tensor) -> torch.Tensor:
    """SRGB curve, continued above 1."""
    safe = linear.clamp_min(0.0031308)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * safe ** (1 / 2.4) - 0.055)
