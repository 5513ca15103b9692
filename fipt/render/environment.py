"""Light from outside as kernels see it."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render.surface import alias_table
from fipt.scene.environment import EnvironmentMap
from fipt.scene.sun import Sun, split


class SunTexels:
    """The sun of a map, for sampling inside kernels."""

    def __init__(self, sun: Sun) -> None:
        self.count = len(sun.radius)
        threshold, alias = alias_table(sun.chance)
        self.alias = mi.Float(np.stack([threshold, alias], axis=1).astype(np.float32).ravel())
        self.axis = mi.Float(np.concatenate([sun.direction, np.tan(sun.radius)[:, None]], 1).astype(np.float32).ravel())
        arriving = sun.irradiance / sun.chance[:, None]
        self.arriving = mi.Float(np.pad(arriving, ((0, 0), (0, 1))).astype(np.float32).ravel())

    def sample(self, u: "mi.Float", u1: "mi.Float", u2: "mi.Float") -> tuple["mi.Vector3f", "mi.Color3f"]:
        """Direction to a point of the sun, by power, and irradiance across it over its density."""
        x = u * self.count
        slot = dr.minimum(mi.UInt32(x), self.count - 1)
        entry = dr.gather(mi.Vector2f, self.alias, slot)
        chosen = dr.select(x - mi.Float(slot) < entry.x, slot, mi.UInt32(entry.y))
        axis, arriving = (dr.gather(mi.Vector4f, array, chosen) for array in (self.axis, self.arriving))
        disc = mi.warp.square_to_uniform_disk(mi.Point2f(u1, u2)) * axis.w
        toward = mi.Frame3f(mi.Vector3f(axis.x, axis.y, axis.z)).to_world(mi.Vector3f(disc.x, disc.y, 1))
        return dr.normalize(toward), mi.Color3f(arriving.x, arriving.y, arriving.z)


class Sky:
    """The light that rays find which leave the mesh, for kernels: a map without its sun, and the sun.

    Parameters
    ----------
    environment
        A map that shines; see `sky_of`.

    Attributes
    ----------
    sun
        What `lookup` leaves out, because rays of a lobe would hardly find it; None where there is none.
    """

    def __init__(self, environment: EnvironmentMap) -> None:
        environment, sun = split(environment)
        self.sun = None if sun is None else SunTexels(sun)
        self.height, self.width = environment.radiance.shape[:2]
        self.map_from_world = [[float(v) for v in row] for row in environment.map_from_world]
        self.texel = mi.Float(np.pad(environment.radiance, ((0, 0), (0, 0), (0, 1))).astype(np.float32).ravel())

    def lookup(self, direction: "mi.Vector3f", active: "mi.Bool") -> "mi.Color3f":
        """Radiance from outside against ``direction``, a unit vector away from the surface: not the sun's; bilinear."""
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
