"""Spots: lights at a point, with a cone and a soft edge; the falloff of Mitsuba's ``spot``."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.scene.setup import NewLight, SpotLight


@dataclass(frozen=True)
class Spot:
    """A light at a point.

    Attributes
    ----------
    position, direction
        (3,) metres; unit vector along the axis.
    intensity
        (3,) radiant intensity along the axis, W/sr.
    cutoff, beam
        Angles from the axis, radians: no light beyond the first, all of it up to the second, between them in
        proportion to the angle.
    """

    position: np.ndarray
    direction: np.ndarray
    intensity: np.ndarray
    cutoff: float
    beam: float

    def at(self, origin: "mi.Point3f") -> tuple["mi.Color3f", "mi.Vector3f", "mi.Float"]:
        """What arrives at a point if nothing is between, W/m2 across the ray; direction and distance to the spot."""
        away = mi.Point3f(*map(float, self.position)) - origin
        distance2 = dr.maximum(dr.squared_norm(away), 1e-12)
        distance = dr.sqrt(distance2)
        wl = away / distance
        angle = dr.safe_acos(-dr.dot(wl, mi.Vector3f(*map(float, self.direction))))
        falloff = dr.clip((self.cutoff - angle) / (self.cutoff - self.beam), 0, 1)
        return mi.Color3f(*map(float, self.intensity)) * (falloff / distance2), wl, distance


def spots_of(lights: Sequence[NewLight]) -> list[Spot]:
    """The spots among the new lights of a setup."""
    return [_spot(light) for light in lights if isinstance(light, SpotLight)]


def _spot(light: SpotLight) -> Spot:
    position = np.array(light.position, float)
    axis = np.array(light.axis, float)
    cutoff = np.radians(light.cone_angle / 2)
    return Spot(
        position,
        axis / np.linalg.norm(axis),
        np.array(light.intensity, float),
        float(cutoff),
        float(cutoff - np.radians(light.soft_edge)),
    )
