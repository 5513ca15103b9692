"""Directions for rays."""

import numpy as np

R2 = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 low-discrepancy sequence (Roberts 2018)."""


def all_around(count: int) -> np.ndarray:
    """(count, 3) float32 unit vectors spread evenly over the sphere: a golden spiral."""
    y = 1 - (2 * np.arange(count) + 1) / count
    phi = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(phi), y, ring * np.sin(phi)], axis=1).astype(np.float32)


def cosine_directions(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) float32 directions about normals (N, 3): a normal plus a point of the unit sphere."""
    sphere = rng.standard_normal((len(normal), 3), dtype=np.float32)
    return _about(normal, sphere / np.maximum(np.linalg.norm(sphere, axis=1, keepdims=True), 1e-9))


def even_cosine_directions(normal: np.ndarray, index: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(N, 3) float32 directions about normals (N, 3), spread more evenly than random ones.

    Each is the ``index``-th (N,) of an R2 sequence that is shifted by ``shift`` (N, 2), in [0, 1).
    """
    u, v = ((index[:, None] * np.array(R2) + shift) % 1).T
    ring, phi = 2 * np.sqrt(u * (1 - u)), 2 * np.pi * v
    return _about(normal, np.stack([ring * np.cos(phi), 1 - 2 * u, ring * np.sin(phi)], axis=1))


def _about(normal: np.ndarray, sphere: np.ndarray) -> np.ndarray:
    """(N, 3) float32 directions to points of unit spheres (N, 3) that stand on the surface."""
    direction = normal + sphere * (1 - 1e-4)
    return (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
