"""The method's reflectance for Mitsuba's own integrators, by which ground truth is rendered.

It is written without our tracer's GGX functions: each checks the other.
"""

from typing import Any

NAME = "fipt_ggx"
"""Plugin name for ``mitsuba.load_dict``."""


def register() -> None:
    """Register ``fipt_ggx`` with Mitsuba; call after the variant is set, as often as you like.

    Its parameters are textures: ``base_color`` (RGB in [0, 1]), ``roughness`` (in [0.02, 1]) and
    ``metallic`` (in [0, 1]). Both sides of a surface reflect alike.
    """
    import fipt.render.bsdf_plugin  # noqa: F401 - its import registers


def textured(surface: Any) -> Any:
    """Return the BSDF of a `fipt.render.texels.MappedSurface`."""
    import mitsuba as mi

    from fipt.render.bsdf_plugin import FiptGgx

    made = FiptGgx(mi.Properties())
    made.base_color, made.roughness, made.metallic = surface.base_color, surface.roughness, surface.metallic
    return made
