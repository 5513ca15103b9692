"""Light from outside as kernels see it."""

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.scene.environment import EnvironmentMap


class Sky:
    """The radiance of rays that leave the mesh, for lookups inside kernels.

    Parameters
    ----------
    background
        A map that shines; see `sky_of`.
    """

    def __init__(self, environment: EnvironmentMap) -> None:
        self.height, self.width = environment.radiance.shape[:2]
        self.map_from_world = [[float(v) for v in row] for row in environment.map_from_world]
        self.texel = mi.Float(np.pad(environment.radiance, ((0, 0), (0, 0), (0, 1))).astype(np.float32).ravel())

    def lookup(self, direction: "mi.Vector3f", active: "mi.Bool") -> "mi.Color3f":
        """Radiance that comes from outside against ``direction``, a unit vector away from the surface; bilinear."""
        if self.height == 1:
            return self._texel(mi.Int32(0), mi.Int32(0), active)
        d = mi.Vector3f(*(dr.dot(mi.Vector3f(*row), direction) for row in self.map_from_world))
        # at the poles any column will do, but atan2(0, 0) will not
        pole = dr.abs(d.x) + dr.abs(d.z) < 1e-12
        u = 0.5 + dr.atan2(d.x, dr.select(pole, 1.0, -d.z)) * dr.inv_two_pi
        x, y = u * self.width - 0.5, dr.acos(dr.clip(d.y, -1, 1)) * (self.height * dr.inv_pi) - 0.5
        column, row = dr.floor(x), dr.floor(y)
        tx, ty = x - column, y - row
        left, right = mi.Int32(column), mi.Int32(column) + 1
        left, right = (dr.select(left < 0, self.width - 1, left), dr.select(right >= self.width, 0, right))
        upper, lower = dr.maximum(mi.Int32(row), 0), dr.minimum(mi.Int32(row) + 1, self.height - 1)
        above = dr.lerp(self._texel(upper, left, active), self._texel(upper, right, active), tx)
        below = dr.lerp(self._texel(lower, left, active), self._texel(lower, right, active), tx)
        return dr.lerp(above, below, ty)

    def _texel(self, row: "mi.Int32", column: "mi.Int32", active: "mi.Bool") -> "mi.Color3f":
        v = dr.gather(mi.Vector4f, self.texel, mi.UInt32(row * self.width + column), active)
        return mi.Color3f(v.x, v.y, v.z)


def sky_of(environment: EnvironmentMap) -> Sky | None:
    """Return the background for kernels; None where no light comes from outside, which costs nothing."""
    return Sky(environment) if environment.emits else None
