"""Materials of a scene file as base colour, roughness and metallic; docs/stages/scene-files.md has the rules."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.render.assets import metal
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.textures import Map, constant, read_map
from fipt.synthetic.scenefile.xml import Node

log = logging.getLogger(__name__)

MATTE = 0.9
"""Roughness of what is purely diffuse: our reflectance always has a little gloss, and here it is hardly seen."""

DARKEST = 0.01
BRIGHTEST = 0.9
BRIGHTEST_METAL = 0.95
"""Base colours are kept within these: black tells nothing of a surface, and white walls keep light for ever."""

_OPAQUE = 0.05
"""Transmittance below which a dielectric is black instead of clear."""
_STAND_IN = 0.5
_NORMALS = ("bumpmap", "normalmap", "bump")


@dataclass(frozen=True)
class ConvertedBsdf:
    """What a bsdf becomes.

    Attributes
    ----------
    base, roughness, metallic
        Maps; the latter two are grey.
    rule
        How it was found, for the log.
    opacity
        Where a mask leaves the surface away; None where it is whole.
    clear
        Light passes through: its surfaces are dropped.
    flagged
        It stands in for something that is missing or unknown.
    """

    base: Map
    roughness: Map
    metallic: Map
    rule: str
    opacity: Map | None = None
    clear: bool = False
    flagged: bool = False

    @property
    def textures(self) -> list[Map]:
        """Its maps that are not constant, the base colour's first."""
        return [found for found in (self.base, self.roughness, self.metallic) if not found.constant]

    @property
    def from_uv(self) -> np.ndarray:
        """(2, 3) matrix of `Map.from_uv` for all its maps: that of the first texture."""
        return (self.textures or [self.base])[0].from_uv

    def lies_otherwise(self, found: Map) -> bool:
        """Whether a map of it lies otherwise on the surface than its first texture; then its mean is used."""
        return not found.constant and not np.allclose(found.from_uv, self.from_uv)


def _converted(base: Map, roughness: Map | float, metallic: Map | float, rule: str) -> ConvertedBsdf:
    roughness, metallic = (m if isinstance(m, Map) else constant(m) for m in (roughness, metallic))
    flagged = any(found.flagged for found in (base, roughness, metallic))
    return ConvertedBsdf(base, roughness, metallic, rule, flagged=flagged)


def converted(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    """Apply the rule of a bsdf's plugin; an unknown one is noted as a problem and becomes grey."""
    rule = _RULES.get(node.type)
    if rule is None:
        source.refuse(node, f"bsdf {node.type}")
        return replace(_converted(constant(_STAND_IN), MATTE, 0.0, f"unknown bsdf {node.type}: grey"), flagged=True)
    return rule(node, source)


def material(name: str, found: ConvertedBsdf, smoothest: float) -> RoomMaterial:
    """Return the finished material: values within their ranges."""
    roughness, metallic = (
        m.grey.mean(keepdims=True) if found.lies_otherwise(m) else m.grey for m in (found.roughness, found.metallic)
    )
    brightest = BRIGHTEST_METAL if metallic.mean() > 0.5 else BRIGHTEST
    for what, values, most in (("base color", found.base.values, brightest), ("roughness", roughness, 1.0)):
        if values.max(initial=0) > 1.001:
            log.warning("material %s: its %s reaches %.3g, which is taken as %.3g", name, what, values.max(), most)
    base = found.base.values.clip(DARKEST, brightest)
    return RoomMaterial(name, base, roughness.clip(smoothest, 1), metallic.clip(0, 1), found.flagged)


def described(made: RoomMaterial, found: ConvertedBsdf) -> str:
    """Return the log's line on a material."""

    def shown(values: np.ndarray) -> str:
        mean = np.atleast_1d(values.mean(axis=(0, 1)))
        return ", ".join(f"{v:.3g}" for v in mean) + (" in the mean" if values.shape[:2] != (1, 1) else "")

    image = f"{found.base.image} ({shown(made.base_color)})" if found.base.image else shown(made.base_color)
    parts = [found.rule, f"base colour {image}", f"roughness {shown(made.roughness)}"]
    parts.append(f"metallic {shown(made.metallic)}")
    for name in ("roughness", "metallic"):
        if found.lies_otherwise(getattr(found, name)):
            parts.append(f"its {name} lies otherwise on the surface: the mean is used")
    if made.flagged:
        parts.append("FLAGGED: stands in for something missing or unknown")
    return f"material {made.name}: " + "; ".join(parts)


# --- the rules --------------------------------------------------------------------------------------


def _diffuse(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    base = read_map(node.get("reflectance", "diffuse_reflectance"), 0.5, source)
    return _converted(base, MATTE, 0.0, node.type)


def _transmitter(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    base = read_map(node.get("transmittance", "diffuse_transmittance"), 0.5, source)
    return _converted(base, MATTE, 0.0, f"{node.type}: as if it reflected what it lets through")


def _plastic(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    base = read_map(node.get("diffuse_reflectance"), 0.5, source)
    roughness = 0.0 if node.type == "plastic" else _roughness(node, source, 0.1)
    return _converted(base, roughness, 0.0, node.type)


def _conductor(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    eta, k = _indices(node, source)
    tint = read_map(node.get("specular_reflectance"), 1.0, source)
    normal = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    rough = node.type == "roughconductor"
    found = _converted(
        tint.with_values(tint.values * normal.astype(np.float32)),
        _roughness(node, source, 0.1) if rough else 0.0, 1.0, node.type,
    )  # fmt: skip
    return replace(found, rule=f"{node.type}, reflectance at normal incidence")


def _indices(node: Node, source: SceneFileReader) -> tuple[np.ndarray, np.ndarray]:
    """Eta and k (3,) relative to what is around, from a named metal or the values that are given."""
    eta, k = node.get("eta"), node.get("k")
    outside = node.get("ext_eta")
    around = outside.as_number() if outside is not None and outside.tag != "string" else 1.0
    name = node.text("material", "none" if eta is None and k is None else "")
    if name:
        known = metal(name)
        if known is None:
            source.refuse(node, f"conductor {name}")
            known = np.zeros(3), np.ones(3)  # Mitsuba's "none": a perfect mirror
        return known[0] / around, known[1] / around
    first, second = (read_map(value, default, source, light=True).mean for value, default in ((eta, 0.0), (k, 1.0)))
    return first / around, second / around


def _roughness(node: Node, source: SceneFileReader, default: float) -> Map:
    """Roughness of alpha (GGX, taken as it is for other distributions too): its square root; of two, the mean's."""
    sides = [node.get("alpha_u"), node.get("alpha_v")]
    if any(sides):
        first, second = (read_map(side, default, source) for side in sides)
        alpha = constant(np.sqrt(first.mean.mean() * second.mean.mean()))
    else:
        alpha = read_map(node.get("alpha"), default, source)
    return replace(alpha.with_values(np.sqrt(np.maximum(alpha.grey, 0))), flagged=alpha.flagged)


def _lobe(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    """Phong and Ward: a diffuse and a glossy share; the larger one says whether it is a metal."""
    diffuse = read_map(node.get("diffuse_reflectance"), 0.5, source)
    gloss = read_map(node.get("specular_reflectance"), 0.2, source)
    if node.type == "phong":
        exponent = read_map(node.get("exponent"), 30.0, source).mean.mean()
        roughness: Map | float = (2 / (exponent + 2)) ** 0.25
    else:
        roughness = _roughness(node, source, 0.1)
    metallic = float(gloss.mean @ LUMINANCE) > max(float(diffuse.mean @ LUMINANCE), 0.3)
    rule = f"{node.type}, its {'glossy' if metallic else 'diffuse'} share"
    return _converted(gloss if metallic else diffuse, roughness, float(metallic), rule)


def _principled(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    base = read_map(node.get("base_color"), 0.5, source)
    through = read_map(node.get("spec_trans"), 0.0, source).mean.mean()
    found = _converted(
        base, read_map(node.get("roughness"), 0.5, source), read_map(node.get("metallic"), 0.0, source), node.type
    )
    return replace(found, clear=True, rule=f"{node.type} that transmits") if through > 0.5 else found


def _dielectric(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    let_through = read_map(node.get("specular_transmittance"), 1.0, source)
    if let_through.mean.max() > _OPAQUE:
        return replace(_converted(constant(1.0), 0.0, 0.0, node.type), clear=True)
    roughness = _roughness(node, source, 0.1) if node.type == "roughdielectric" else 0.0
    return _converted(constant(0.0), roughness, 0.0, f"{node.type} that transmits nothing: black below a clear surface")


def _null(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    return replace(_converted(constant(1.0), 0.0, 0.0, "null"), clear=True)


# --- materials around others --------------------------------------------------------------------------


def _nested(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    """What is inside: of twosided, bump and normal maps that is all."""
    inner = node.objects("bsdf")
    if not inner:
        raise node.wrong(f"a {node.type} bsdf must have another one inside")
    if node.type == "twosided" and len(inner) > 1:
        source.note(f"bsdf {node.id or node.where}: two sides of different materials; both become the first")
    elif node.type in _NORMALS:
        _ignored(node, source)
    return converted(inner[0], source)


def note_ignored(scene: Node, source: SceneFileReader) -> None:
    """Note bump and normal maps of the whole file: shapes may refer to what is inside them."""
    for bsdf in scene.objects("bsdf"):
        for node in bsdf.walk():
            if node.type in _NORMALS:
                _ignored(node, source)


def _ignored(node: Node, source: SceneFileReader) -> None:
    named = next((inner.id for inner in node.walk() if inner.tag == "bsdf" and inner.id), node.where)
    source.note(f"bsdf {named}: the {node.type} is ignored")


def _coating(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    found = _nested(node, source)
    if found.clear or found.metallic.mean.mean() > 0.5:
        return found
    coat = _roughness(node, source, 0.1) if node.type == "roughcoating" else constant(0.0)
    return replace(found, roughness=coat, rule=f"{found.rule} under a {node.type}, whose roughness it takes")


def _mask(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    found = _nested(node, source)
    opacity = read_map(node.get("opacity"), 0.5, source)
    if opacity.alpha is not None:  # of a picture with an alpha channel, that is what the mask is
        opacity = opacity.with_values(opacity.alpha)
    if not opacity.constant:
        rule = f"{found.rule}, cut where its mask is mostly clear"
        return replace(found, opacity=opacity, rule=rule, flagged=found.flagged or opacity.flagged)
    share = float(opacity.mean.mean())
    if share < 0.5:
        return replace(found, clear=True, rule=f"mask of opacity {share:.3g}")
    rule = found.rule if share == 1 else f"{found.rule}, its mask of opacity {share:.3g} taken as whole"
    return replace(found, rule=rule, flagged=found.flagged or opacity.flagged)


def _blend(node: Node, source: SceneFileReader) -> ConvertedBsdf:
    inner = [converted(child, source) for child in node.objects("bsdf")]
    if len(inner) < 2:
        raise node.wrong(f"a {node.type} must have two bsdfs inside; found {len(inner)}")
    if node.type == "mixturebsdf":
        weights = node.text("weights").replace(",", " ").split()
        shares = [constant(float(word)) for word in weights] + [constant(0.0)] * (len(inner) - len(weights))
    else:
        weight = read_map(node.get("weight"), 0.5, source)
        if weight.values.max(initial=0) > 1.001:
            log.warning("%s: the weight of a %s reaches %.3g, more than 1", node.where, node.type, weight.values.max())
            weight = weight.with_values(weight.values.clip(0, 1))
        shares = [weight.with_values(1 - weight.values), weight]
        inner = inner[:2]
    solid = [(found, share) for found, share in zip(inner, shares, strict=False) if not found.clear]
    opaque = sum(float(share.mean.mean()) for _, share in solid)
    if opaque < 0.5:
        return replace(inner[0], clear=True, rule=f"{node.type}, mostly clear")
    masked = any(found.opacity for found, _ in solid)
    return ConvertedBsdf(
        base=_mixed([(found.base, share) for found, share in solid]),
        roughness=_mixed([(found.roughness, share) for found, share in solid]),
        metallic=_mixed([(found.metallic, share) for found, share in solid]),
        rule=f"{node.type} of " + " and ".join(found.rule for found, _ in solid),
        opacity=_mixed([(found.opacity or constant(1.0), share) for found, share in solid]) if masked else None,
        flagged=any(found.flagged for found in inner),
    )


def _mixed(parts: list[tuple[Map, Map]]) -> Map:
    """Weigh maps. One that lies otherwise on the surface than the first large one counts with its mean."""
    maps = [found for pair in parts for found in pair]
    frame = max(maps, key=lambda found: found.values.size)
    shape = frame.values.shape[:2]

    def fitted(found: Map) -> np.ndarray:
        if found.constant or not np.allclose(found.from_uv, frame.from_uv):
            return found.mean[None, None]
        rows, columns = (np.arange(n) * m // n for n, m in zip(shape, found.values.shape[:2], strict=True))
        return found.values[rows[:, None], columns]

    total = sum(fitted(share) for _, share in parts)
    mixed = sum(fitted(found) * fitted(share) for found, share in parts) / np.maximum(total, 1e-6)
    images = " and ".join(sorted({found.image for found, _ in parts if found.image}))
    return replace(frame.with_values(np.broadcast_to(mixed, (*shape, 3))), image=images)


_RULES: dict[str, Callable[[Node, SceneFileReader], ConvertedBsdf]] = {
    **dict.fromkeys(("diffuse", "roughdiffuse", "orennayar"), _diffuse),
    **dict.fromkeys(("difftrans", "translucent"), _transmitter),
    **dict.fromkeys(("plastic", "roughplastic", "pplastic"), _plastic),
    **dict.fromkeys(("conductor", "roughconductor"), _conductor),
    **dict.fromkeys(("phong", "ward"), _lobe),
    **dict.fromkeys(("principled", "principledthin"), _principled),
    **dict.fromkeys(("dielectric", "roughdielectric", "thindielectric"), _dielectric),
    **dict.fromkeys(("twosided", *_NORMALS), _nested),
    **dict.fromkeys(("coating", "roughcoating"), _coating),
    **dict.fromkeys(("blendbsdf", "mixturebsdf"), _blend),
    "mask": _mask,
    "null": _null,
}
