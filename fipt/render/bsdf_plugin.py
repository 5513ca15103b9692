"""The method's reflectance as a Mitsuba BSDF. Import this module once the variant is set: it registers ``fipt_ggx``.

Exports ship this file too (`fipt.stages.export.mitsuba_files`), so it asks for nothing of fipt but constants.

Symbols (paper, Sec. 3): i direction to the light, o to the camera, h half vector, n normal;
a base colour, s roughness, m metallic, alpha = s^2.

    kd = a (1 - m)                ks = 0.04 (1 - m) + a m
    f(i,o) = kd / pi + D(h) F(o.h) g(n.i) g(n.o) / 4
    D = alpha^2 / (pi ((n.h)^2 (alpha^2 - 1) + 1)^2)
    F = ks + (1 - ks) (1 - o.h)^5
    g(c) = 1 / (c (1 - k) + k),  k = (s + 1)^2 / 8
"""

from typing import Any

import drjit as dr
import mitsuba as mi

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_MIN

NAME = "fipt_ggx"


class FiptGgx(mi.BSDF):
    """Lambert plus GGX; `sample` mixes a cosine lobe and a half-vector lobe."""

    def __init__(self, props: Any) -> None:
        super().__init__(props)
        self.base_color = props.get_texture("base_color", 0.5)
        self.roughness = props.get_texture("roughness", 1.0)
        self.metallic = props.get_texture("metallic", 0.0)
        sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection | sides,
            mi.BSDFFlags.GlossyReflection | sides,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def traverse(self, callback: Any) -> None:
        """Name the three textures as parameters."""
        for name in ("base_color", "roughness", "metallic"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    # --- the formulas -------------------------------------------------------------------

    def _parameters(self, si: Any, active: Any) -> tuple:
        """Evaluate kd, ks, s and the probability of drawing from the GGX lobe."""
        color = self.base_color.eval(si, active)
        roughness = dr.maximum(self.roughness.eval_1(si, active), ROUGHNESS_MIN)
        metallic = self.metallic.eval_1(si, active)
        kd = color * (1 - metallic)
        ks = F0_DIELECTRIC * (1 - metallic) + color * metallic
        diffuse, specular = mi.luminance(kd), mi.luminance(ks)
        # A dielectric reflects more at grazing angles than ks says: never starve that lobe.
        glossy = dr.clip(specular / (diffuse + specular + 1e-6), 0.25, 1.0)
        return kd, ks, roughness, glossy

    def _distribution(self, h: Any, roughness: Any) -> Any:
        """D(h), with 1 - (n.h)^2 taken from the tangent components to keep its digits."""
        alpha2 = dr.square(dr.square(roughness))
        sin2 = dr.square(h.x) + dr.square(h.y)
        return alpha2 * dr.inv_pi / dr.square(dr.square(h.z) * alpha2 + sin2)

    def _evaluate(self, si: Any, wo: Any, active: Any) -> tuple:
        """Return f (n.i) and the density of `sample`, for both directions on one side."""
        kd, ks, roughness, glossy = self._parameters(si, active)
        side = dr.sign(mi.Frame3f.cos_theta(si.wi))
        to_camera, to_light = si.wi * side, wo * side
        cos_o, cos_i = to_camera.z, to_light.z
        active = active & (cos_o > 0) & (cos_i > 0)

        h = dr.normalize(to_camera + to_light)
        o_h = dr.dot(to_camera, h)
        distribution = self._distribution(h, roughness)
        k = dr.square(roughness + 1) / 8
        visibility = dr.rcp((cos_i * (1 - k) + k) * (cos_o * (1 - k) + k))
        schlick = (1 - o_h) ** 5
        fresnel = ks + (1 - ks) * schlick
        value = (kd * dr.inv_pi + fresnel * (distribution * visibility / 4)) * cos_i

        pdf = (1 - glossy) * cos_i * dr.inv_pi + glossy * distribution * h.z / (4 * o_h)
        return dr.select(active, value, 0.0), dr.select(active, pdf, 0.0)

    # --- Mitsuba's interface ------------------------------------------------------------

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        """Draw a direction; return its sample and f (n.i) over its density."""
        _, _, roughness, glossy = self._parameters(si, active)
        side = dr.sign(mi.Frame3f.cos_theta(si.wi))
        to_camera = si.wi * side
        from_ggx = sample1 < glossy

        cosine = mi.warp.square_to_cosine_hemisphere(sample2)
        # (n.h)^2 = (1 - u) / (1 + (alpha^2 - 1) u) inverts the distribution of D (n.h).
        alpha2 = dr.square(dr.square(roughness))
        sin2 = alpha2 * sample2.x / (1 + (alpha2 - 1) * sample2.x)
        sin_phi, cos_phi = dr.sincos(2 * dr.pi * sample2.y)
        sin_h = dr.safe_sqrt(sin2)
        h = mi.Vector3f(cos_phi * sin_h, sin_phi * sin_h, dr.safe_sqrt(1 - sin2))
        reflected = 2 * dr.dot(to_camera, h) * h - to_camera

        bs: Any = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(from_ggx, reflected, cosine) * side
        bs.eta = 1.0
        bs.sampled_type = dr.select(
            from_ggx,
            mi.UInt32(+mi.BSDFFlags.GlossyReflection),
            mi.UInt32(+mi.BSDFFlags.DiffuseReflection),
        )
        bs.sampled_component = dr.select(from_ggx, mi.UInt32(1), mi.UInt32(0))
        value, bs.pdf = self._evaluate(si, bs.wo, active)
        valid = bs.pdf > 0
        return bs, dr.select(valid, value / dr.select(valid, bs.pdf, 1.0), 0.0)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """Return f (n.i)."""
        return self._evaluate(si, wo, active)[0]

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """Return the density of `sample`, per steradian."""
        return self._evaluate(si, wo, active)[1]

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple:
        """Return both at once."""
        return self._evaluate(si, wo, active)

    def to_string(self) -> str:
        """For Mitsuba's own messages."""
        return f"{NAME}[]"


mi.register_bsdf(NAME, lambda props: FiptGgx(props))
