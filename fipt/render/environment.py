"""Light from outside as kernels see it."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render.surface import alias_table
from fipt.scene.environment import EnvironmentMap, solid_angles
from fipt.scene.sun import split


class Sky:
    """The light that rays find which leave the mesh, for kernels: a bilinear map, and the texels of its sun, each even.

    Rays of a lobe hardly ever meet the sun. So its texels are sampled, too, by their power.

    Parameters
    ----------
    environment
        A map that shines; see `sky_of`.

    Attributes
    ----------
    suns
        Number of texels of the sun.
    """

    def __init__(self, environment: EnvironmentMap) -> None:
        self.height, self.width = environment.radiance.shape[:2]
        self.map_from_world = [[float(v) for v in row] for row in environment.map_from_world]
        rest, _ = split(environment)
        beyond = environment.radiance.astype(np.float64) - rest.radiance
        row, column = np.nonzero(beyond.max(axis=-1) > 0)
        self.suns = len(row)
        number = np.zeros((self.height, self.width, 1), np.float32)  # of a texel of the sun; 0: of none
        number[row, column, 0] = 1 + np.arange(self.suns)
        self.texel = mi.Float(np.concatenate([rest.radiance, number], axis=2).astype(np.float32).ravel())
        if self.suns:
            self._prepare_sun(beyond[row, column], row, column)

    def _prepare_sun(self, radiance: np.ndarray, row: np.ndarray, column: np.ndarray) -> None:
        """Tables of the sun's texels (K,), which have radiance (K, 3) beyond the rest of the map."""
        angle = solid_angles(self.height, self.width)[row, 0]
        chance = radiance.mean(axis=1) * angle
        chance /= chance.sum()
        threshold, alias = alias_table(chance)
        self.alias = mi.Float(np.stack([threshold, alias], axis=1).astype(np.float32).ravel())
        top, bottom = (np.cos(np.pi * (row + k) / self.height) for k in (0, 1))
        left, density = (column / self.width - 0.5) * 2 * np.pi, chance / angle
        self.border = mi.Float(np.stack([top, bottom, left, density], axis=1).astype(np.float32).ravel())
        own = np.concatenate([radiance, density[:, None]], axis=1)
        self.sun = mi.Float(np.pad(own, ((1, 0), (0, 0))).astype(np.float32).ravel())

    def sample_sun(self, u: "mi.Float", u1: "mi.Float", u2: "mi.Float") -> tuple["mi.Vector3f", "mi.Float"]:
        """Direction to a point of the sun, and its density per steradian."""
        x = u * self.suns
        slot = dr.minimum(mi.UInt32(x), self.suns - 1)
        entry = dr.gather(mi.Vector2f, self.alias, slot)
        chosen = dr.select(x - mi.Float(slot) < entry.x, slot, mi.UInt32(entry.y))
        border = dr.gather(mi.Vector4f, self.border, chosen)
        # a little inside: rounding must not move it into the next texel
        y, phi = dr.lerp(border.x, border.y, _inside(u1)), border.z + _inside(u2) * (dr.two_pi / self.width)
        sine = dr.safe_sqrt(1 - y * y)
        d = (sine * dr.sin(phi), y, -sine * dr.cos(phi))
        columns = zip(*self.map_from_world, strict=True)
        return mi.Vector3f(*(sum(m * v for m, v in zip(column, d, strict=True)) for column in columns)), border.w

    def lookup(self, direction: "mi.Vector3f", active: "mi.Bool") -> tuple["mi.Color3f", "mi.Float"]:
        """What is outside along ``direction``, a unit vector away from the surface.

        Returns
        -------
        radiance
            Of the map, bilinear, and of the sun's texel.
        density
            With which `sample_sun` draws the direction, per steradian.
        """
        if self.height == 1:
            return self._texel(mi.Int32(0), mi.Int32(0), active), mi.Float(0.0)
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
        radiance = dr.lerp(above, below, ty)
        if not self.suns:
            return radiance, mi.Float(0.0)
        nearest = dr.select(ty < 0.5, upper, lower) * self.width + dr.select(tx < 0.5, left, right)
        number = mi.UInt32(dr.gather(mi.Vector4f, self.texel, mi.UInt32(nearest), active).w)
        own = dr.gather(mi.Vector4f, self.sun, number, active)
        return radiance + mi.Color3f(own.x, own.y, own.z), own.w

    def _texel(self, row: "mi.Int32", column: "mi.Int32", active: "mi.Bool") -> "mi.Color3f":
        v = dr.gather(mi.Vector4f, self.texel, mi.UInt32(row * self.width + column), active)
        return mi.Color3f(v.x, v.y, v.z)


def _inside(u: "mi.Float") -> "mi.Float":
    """A number from 0 to 1, kept off both ends."""
    return dr.lerp(mi.Float(1e-3), mi.Float(1 - 1e-3), u)


def sky_of(environment: EnvironmentMap) -> Sky | None:
    """Return the background for kernels; None where no light comes from outside, which costs nothing."""
    return Sky(environment) if environment.emits else None
