"""Directions for rays."""

import numpy as np


def all_around(count: int) -> np.ndarray:
    """(count, 3) float32 unit vectors spread evenly over the sphere: a golden spiral."""
    y = 1 - (2 * np.arange(count) + 1) / count
    phi = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(phi), y, ring * np.sin(phi)], axis=1).astype(np.float32)


def cosine_directions(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) float32 directions about normals (N, 3): a normal plus a point of the unit sphere."""
    sphere = rng.standard_normal((len(normal), 3), dtype=np.float32)
    sphere /= np.maximum(np.linalg.norm(sphere, axis=1, keepdims=True), 1e-9)
    direction = normal + sphere * (1 - 1e-4)
    return (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
