"""Light of the sun at points of the surface, by shadow rays."""

import numpy as np

from fipt.render.scene import RayScene
from fipt.scene.sun import Sun

_TO_SUN = 16
"""Rays a point: the border of a shadow has as many steps."""


def sunlight(scene: RayScene, sun: Sun, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N, 3) irradiance over pi that the sun gives to points (N, 3) with normals (N, 3)."""
    rng = np.random.default_rng(0)
    result = np.zeros((len(position), 3))
    origin = (position + scene.epsilon * normal).astype(np.float32)
    for k in range(_TO_SUN):
        u, u1, u2 = rng.random((3, len(position)))
        direction, arriving = sun.toward((k + u) / _TO_SUN, u1, u2)
        cos = (direction * normal).sum(axis=1)
        facing = np.flatnonzero(cos > 0)
        _, triangle = scene.intersect(origin[facing], direction[facing].astype(np.float32))
        lit = facing[triangle < 0]
        result[lit] += arriving[lit] * cos[lit, None]
    return result / (np.pi * _TO_SUN)
