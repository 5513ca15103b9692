"""Reflectance terms and samplers in Dr.Jit, in the symbols of the paper.

Legend: n normal, i (``wi``) to the light, o (``wo``) to the viewer, h half vector, s roughness, alpha = s^2,
D normal distribution, G masking-shadowing divided by (n.i)(n.o), Fc = (1 - o.h)^5 Schlick's weight.

    f(i,o) = kd / pi + D(h; s) F(o.h) G(i,o; s) / 4,   F = ks (1 - Fc) + Fc
"""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

import drjit as dr
import mitsuba as mi

from fipt.model.reflectance import diffuse_reflectance, specular_reflectance


def d_ggx(cos_h: "mi.Float", sin2_h: "mi.Float", alpha: "mi.Float") -> "mi.Float":
    """GGX normal distribution D(h), per steradian.

    ``sin2_h`` is 1 - cos_h^2, given apart since the difference cancels near the lobe's centre.
    """
    a2 = dr.square(alpha)
    # at least alpha^2 for a real half vector; both terms vanish for one that points into the surface
    return a2 / (dr.pi * dr.square(dr.maximum(dr.fma(dr.square(cos_h), a2, sin2_h), 1e-8)))


def g_one(cos: "mi.Float", s: "mi.Float") -> "mi.Float":
    """One side of G: 1 / (c (1 - k) + k) with k = (s + 1)^2 / 8; already divided by the cosine."""
    k = dr.square(s + 1) / 8
    return dr.rcp(dr.fma(cos, 1 - k, k))


def schlick(cos_oh: "mi.Float") -> "mi.Float":
    """Fc = (1 - o.h)^5."""
    x = dr.maximum(1 - cos_oh, 0)
    x2 = dr.square(x)
    return x2 * x2 * x


def sample_cosine(u1: "mi.Float", u2: "mi.Float") -> "mi.Vector3f":
    """Cosine-weighted direction about +z; pdf = cos / pi per steradian."""
    r = dr.sqrt(u1)
    sin_phi, cos_phi = dr.sincos(2 * dr.pi * u2)
    return mi.Vector3f(r * cos_phi, r * sin_phi, dr.safe_sqrt(1 - u1))


def sample_half_vector(u1: "mi.Float", u2: "mi.Float", alpha: "mi.Float") -> "mi.Vector3f":
    """Half vector about +z with pdf D(h) cos(h) per steradian.

    The direction reflected about it has pdf D cos(h) / (4 o.h) per steradian.
    """
    # by the tangent: 1 - cos^2 would cancel for narrow lobes
    tan = alpha * dr.sqrt(u1 / dr.maximum(1 - u1, 1e-9))
    cos = dr.rsqrt(dr.fma(tan, tan, 1))
    sin = tan * cos
    sin_phi, cos_phi = dr.sincos(2 * dr.pi * u2)
    return mi.Vector3f(sin * cos_phi, sin * sin_phi, cos)


def mirrored(wo: "mi.Vector3f", h: "mi.Vector3f") -> "mi.Vector3f":
    """Unit direction that ``wo`` is reflected to about the half vector ``h``."""
    return dr.normalize(dr.fma(2 * dr.dot(wo, h), h, -wo))


class ReflectionGeometry:
    """Cosines of one pair of directions at a surface point with unit normal n (all clamped to >= 0)."""

    def __init__(self, n: "mi.Vector3f", wi: "mi.Vector3f", wo: "mi.Vector3f") -> None:
        h = wi + wo
        length2 = dr.squared_norm(h)
        # opposite directions have no half vector; a NaN here would survive being weighted by zero
        h = dr.select(length2 > 1e-10, h * dr.rsqrt(length2), n)
        self.ni = dr.maximum(dr.dot(n, wi), 0)
        self.no = dr.maximum(dr.dot(n, wo), 0)
        self.nh = dr.maximum(dr.dot(n, h), 0)
        self.oh = dr.maximum(dr.dot(wo, h), 1e-4)
        self.sin2_h = dr.squared_norm(dr.cross(n, h))

    def pdf_cosine(self) -> "mi.Float":
        """Density of `sample_cosine`, per steradian."""
        return self.ni * dr.inv_pi

    def pdf_ggx(self, alpha: "mi.Float") -> "mi.Float":
        """Density of reflecting about `sample_half_vector`, per steradian."""
        return d_ggx(self.nh, self.sin2_h, alpha) * self.nh / (4 * self.oh)

    def specular(self, s: "mi.Float") -> "mi.Float":
        """D G (n.i) / 4: the specular lobe without Fresnel."""
        return d_ggx(self.nh, self.sin2_h, dr.square(s)) * g_one(self.ni, s) * g_one(self.no, s) * self.ni * 0.25


def evaluate(
    g: ReflectionGeometry, base_color: "mi.Color3f", s: "mi.Float", metallic: "mi.Float"
) -> tuple["mi.Color3f", "mi.Float"]:
    """Return f(i,o) (n.i) and the density of choosing i half by cosine, half by GGX."""
    kd, ks = diffuse_reflectance(base_color, metallic), specular_reflectance(base_color, metallic)
    fc = schlick(g.oh)
    value = kd * (dr.inv_pi * g.ni) + (ks * (1 - fc) + fc) * g.specular(s)
    return value, 0.5 * (g.pdf_cosine() + g.pdf_ggx(dr.square(s)))
