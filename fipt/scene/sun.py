"""The sun of an environment map: texels that are few and bright, which rays of a lobe would hardly ever find."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from fipt.scene.environment import EnvironmentMap, solid_angles, texel_directions

_BRIGHT = 30.0 * 3.0 ** np.arange(8)
"""Radiance, in means of the sky without its sun, from which a texel is of the sun: the first that leaves a small one.
Clouds and windows are dimmer; haze around a sun may be brighter."""
_LARGEST = 0.02
"""Steradians that a sun has at most, a disc of 9 degrees: rays of a lobe find what is larger."""
_PASSES = 3
"""Estimates of the mean of the sky, each without the sun of the one before."""


@dataclass(frozen=True)
class Sun:
    """K bright texels of a map, beyond what surrounds them.

    Attributes
    ----------
    direction
        (K, 3) unit world directions to their centres.
    irradiance
        (K, 3) what each gives to a surface that faces it: radiance times solid angle.
    radius
        (K,) angle of the disc that has the texel's solid angle, radians.
    """

    direction: np.ndarray
    irradiance: np.ndarray
    radius: np.ndarray

    @property
    def chance(self) -> np.ndarray:
        """(K,) share of each texel in the sun's power."""
        power = self.irradiance.mean(axis=1)
        return power / power.sum()

    def toward(self, u: np.ndarray, u1: np.ndarray, u2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) directions to points of the sun, by power, of uniform numbers (N,); (N, 3) irradiance over density."""
        chosen = np.minimum(np.searchsorted(np.cumsum(self.chance), u, side="right"), len(self.chance) - 1)
        axis, angle = self.direction[chosen], 2 * np.pi * u2
        across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        away = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
        direction = axis + (np.tan(self.radius[chosen]) * np.sqrt(u1))[:, None] * away
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return direction, self.irradiance[chosen] / self.chance[chosen][:, None]


def sun_texels(environment: EnvironmentMap) -> np.ndarray:
    """(h, w) bool: the texels of the sun; none where nothing is small and bright."""
    level = environment.radiance.mean(axis=-1)
    angle = np.broadcast_to(solid_angles(*level.shape), level.shape)
    for factor in _BRIGHT:
        bright = np.zeros(level.shape, bool)
        for _ in range(_PASSES):
            rest = ~bright
            bright = level > factor * (level * angle)[rest].sum() / angle[rest].sum()
            if angle[bright].sum() > _LARGEST:
                break
        else:
            return bright
    return np.zeros(level.shape, bool)


def split(environment: EnvironmentMap) -> tuple[EnvironmentMap, Sun | None]:
    """Part a map into the sky without its sun, and the sun; None where nothing is small and bright.

    A texel of the sun shines as the sky around the sun does, in the mean, and the rest is the sun's.
    """
    radiance, bright = environment.radiance, sun_texels(environment)
    if not bright.any():
        return environment, None
    height, width = bright.shape
    angle = np.broadcast_to(solid_angles(height, width), bright.shape)
    around = binary_dilation(bright, np.ones((3, 3), bool)) & ~bright
    behind = radiance[around].mean(axis=0, dtype=np.float64)
    row, column = np.nonzero(bright)
    beyond = np.maximum(radiance[row, column] - behind, 0)
    sun = Sun(
        texel_directions(height, width)[row * width + column] @ environment.map_from_world,
        beyond * angle[row, column][:, None],
        np.sqrt(angle[row, column] / np.pi),
    )
    sky = radiance.copy()
    sky[bright] = radiance[bright] - beyond
    return replace(environment, radiance=sky), sun


def with_sun(
    environment: EnvironmentMap, direction: np.ndarray, irradiance: np.ndarray, radius: float, rows: int
) -> EnvironmentMap:
    """Add a disc that shines to a map, which gets so many rows.

    Parameters
    ----------
    direction
        (3,) unit world direction to the disc's centre.
    irradiance
        (3,) what it gives to a surface that faces it.
    radius
        Of the disc, radians; it covers the nearest texel at least.
    """
    directions = texel_directions(rows, 2 * rows) @ environment.map_from_world
    radiance = environment.lookup(directions).reshape(rows, 2 * rows, 3)
    angle = np.arccos(np.clip(directions @ direction, -1, 1)).reshape(rows, 2 * rows)
    covered = angle <= max(radius, float(angle.min()))
    solid = np.broadcast_to(solid_angles(rows, 2 * rows), covered.shape)[covered].sum()
    radiance[covered] += (irradiance / solid).astype(np.float32)
    return replace(environment, radiance=radiance)
