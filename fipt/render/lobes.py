"""Directions at a point: one set, drawn from a cosine lobe and GGX lobes, serves all shading integrals.

Symbols as in `fipt.render.ggx`. The directions are weighed by the balance heuristic (Veach 1997): each counts with one
over the density of all lobes together. Drawing from one lobe at a time, as the paper does, is the special case of one
non-zero count.
"""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render import ggx
from fipt.render.directions import R2
from fipt.render.scene import lanes


class LobeMixture:
    """A cosine lobe and one GGX lobe a roughness level, each with a number of directions.

    Parameters
    ----------
    levels
        Roughness s of each GGX lobe: a number, or (N,) values.
    counts
        Directions drawn from the cosine lobe and from each GGX lobe.

    Attributes
    ----------
    total
        mi.UInt32: directions of all lobes.
    outputs
        Number of integrals: Ld, then Ls0 of every level, then Ls1 of every level.
    """

    def __init__(self, levels: Sequence[float | np.ndarray], counts: Sequence[int]) -> None:
        self._s = [lanes(level, mi.Float) if np.ndim(level) else float(level) for level in levels]
        self._ends = [mi.UInt32(int(c)) for c in np.cumsum(counts)]
        self._counts = [mi.Float(float(c)) for c in counts]
        self._drawn = [count > 0 for count in counts]
        dr.make_opaque(self._ends, self._counts)  # literals would compile a kernel for every sample count
        self.total = self._ends[-1]
        self.outputs = 1 + 2 * len(self._s)

    def sample(
        self,
        k: "mi.UInt32",
        point: "mi.UInt32",
        shift: tuple["mi.Float", "mi.Float"],
        frame: "mi.Frame3f",
        wo: "mi.Vector3f",
    ) -> "mi.Vector3f":
        """Direction number ``k``: stratified over the lobes, low-discrepancy (shifted by ``shift``) within each.

        The points of a sample continue one sequence: ``point`` j has the numbers from j times the lobe's count on.
        """
        start, count, alpha = mi.UInt32(0), self._ends[0], mi.Float(1.0)
        for s, low, high in zip(self._s, self._ends[:-1], self._ends[1:], strict=True):
            inside = (k >= low) & (k < high)
            start, count = dr.select(inside, low, start), dr.select(inside, high - low, count)
            alpha = dr.select(inside, dr.square(s), alpha)
        number = mi.Float(k - start + point * count)
        u1, u2 = dr.fma(number, R2[0], shift[0]), dr.fma(number, R2[1], shift[1])
        u1, u2 = u1 - dr.floor(u1), u2 - dr.floor(u2)
        diffuse = frame.to_world(ggx.sample_cosine(u1, u2))
        h = frame.to_world(ggx.sample_half_vector(u1, u2, alpha))
        return dr.select(k < self._ends[0], diffuse, ggx.mirrored(wo, h))

    def density(self, g: ggx.ReflectionGeometry) -> "mi.Float":
        """Directions per steradian of all lobes together along g's i."""
        density = self._counts[0] * g.pdf_cosine()
        for s, count, drawn in zip(self._s, self._counts[1:], self._drawn[1:], strict=True):
            if drawn:
                density = dr.fma(count, g.pdf_ggx(dr.square(s)), density)
        return density

    def splat(self, integrals: list["mi.Color3f"], g: ggx.ReflectionGeometry, value: "mi.Color3f") -> None:
        """Add ``value`` (radiance from g's i over the density of directions) times each integrand's weight, in place.

        Ld: (n.i) / pi;  Ls0(s): (1 - Fc) D G / 4 (n.i);  Ls1(s): Fc D G / 4 (n.i).
        """
        fc = ggx.schlick(g.oh)
        integrals[0] += value * (g.ni * dr.inv_pi)
        for level, s in enumerate(self._s):
            lobe = value * g.specular(s)
            integrals[1 + level] += lobe * (1 - fc)
            integrals[1 + len(self._s) + level] += lobe * fc
