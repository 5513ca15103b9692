"""Directions for rays."""

import numpy as np


def all_around(count: int) -> np.ndarray:
    """(count, 3) float32 unit vectors spread evenly over the sphere: a golden spiral."""
    y = 1 - (2 * np.arange(count) + 1) / count
    phi = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(phi), y, ring * np.sin(phi)], axis=1).astype(np.float32)
