"""Exported rooms in Mitsuba: what other programs show of them, and the reflectance that they have for it."""

from __future__ import annotations  # Mitsuba has no classes before its variant is set

import itertools
from functools import cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.io.asset import Asset, Piece, Textures, back, mitsuba_map
from fipt.io.cameras import Camera
from fipt.io.images import to_display
from fipt.model.albedo import albedo_terms
from fipt.render import bsdf

SPECULAR = 0.3
"""Mitsuba's ``specular`` of dielectrics. 0.5 reflects 0.04 straight on, as ours; but its highlights lose nothing at
grazing angles, so that over all directions they are brighter than ours. This is a compromise between the two."""

_LAMBERT = 0.65
"""Roughness at which Mitsuba's diffuse lobe is nearest to Lambert's (of directional albedos)."""

_LEVELS = np.linspace(ROUGHNESS_MIN, 1.0, 12)
_SAMPLES = 2**16
_GUIDE_RAYS = 4  # along a pixel


def load_asset(asset: Asset) -> mi.Scene:
    """Scene of a room, its textures taken as parameters of our reflectance.

    glTF and USD leave the reflectance of rough dielectrics to the program; all have Lambert and GGX lobes like ours.
    """
    bsdf.register()
    textures = asset.textures
    surface = mi.load_dict(
        {
            "type": bsdf.NAME,
            "base_color": _texture(textures.linear_color),
            "roughness": _texture(textures.roughness / 255.0),
            "metallic": _texture(textures.metallic / 255.0),
        }
    )
    scene: dict[str, Any] = {"type": "scene", "surface": _shape(asset.surface, bsdf=surface)}
    sheets = [*asset.lamps, *(back(lamp) for lamp in asset.lamps if asset.two_sided)]
    for lamp in sheets:
        parts = {"bsdf": mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})}
        if lamp.radiance.any():
            value = [float(v) for v in lamp.radiance]
            parts["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": value}})
        scene[lamp.name] = _shape(lamp, **parts)
    if asset.outside.shines:
        scene["outside"] = {"type": "envmap", "bitmap": mi.Bitmap(mitsuba_map(asset.outside))}
    return mi.load_dict(scene)


def guides(scene: mi.Scene, asset: Asset, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Base colour and normal (H, W, 3) that a view shows, free of noise, for the denoiser; ``scene`` is the asset's."""
    color = _texture(asset.textures.linear_color)
    surface = next(shape for shape in scene.shapes() if shape.id() == asset.surface.name)
    rows, columns = np.indices((camera.height, camera.width)).reshape(2, -1)
    steps = (np.arange(_GUIDE_RAYS) + 0.5) / _GUIDE_RAYS
    total = np.zeros((2, camera.height * camera.width, 3))
    origin = mi.Point3f(*map(float, camera.center))
    for x, y in itertools.product(steps, steps):
        directions = np.ascontiguousarray(camera.directions(columns + x, rows + y).T)
        si = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(*map(mi.Float, directions))))
        # lamps are as bright as white, as the denoiser wants it; outside is black
        seen = dr.select(si.shape == mi.ShapePtr(surface), color.eval(si), 1.0)
        total += np.stack([np.array(dr.select(si.is_valid(), v, 0.0)).T for v in (seen, mi.Color3f(si.n))])
    shape = camera.height, camera.width, 3
    base, normal = (part.reshape(shape).astype(np.float32) for part in total / _GUIDE_RAYS**2)
    return base, normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)


def load_scene_file(path: Path) -> mi.Scene:
    """Load a Mitsuba scene file that was exported.

    Raises
    ------
    FiptError
        If Mitsuba cannot read it.
    """
    bsdf.register()  # scene_exact.xml asks for it; a user imports fipt_bsdf.py instead
    try:
        return mi.load_file(str(path))
    except RuntimeError as error:
        raise FiptError(f"Mitsuba cannot load {path} ({error})", "export it again") from error


def render_sensor(scene: mi.Scene, sensor: int, spp: int, seed: int) -> np.ndarray:
    """(H, W, 3) float32 picture of one of the scene's own cameras, by its own integrator."""
    picture = mi.render(scene, sensor=sensor, spp=spp, seed=seed)
    return np.array(picture, np.float32)[..., :3]


def principled_textures(textures: Textures) -> Textures:
    """Return parameters with which Mitsuba's ``principled`` comes near to our reflectance.

    Its diffuse lobe depends on roughness: nearest to Lambert's is that of `_LAMBERT`, which is taken for all rougher
    dielectrics, whose highlights are faint. Its highlights lose less at grazing angles than ours. For each roughness
    and metallic the share of uniform light that is reflected is linear in the base colour, here and there; the base
    colour is chosen to make the two equal, as far as [0, 1] allows.
    """
    rough, metal = textures.roughness / 255.0, textures.metallic / 255.0
    theirs = np.where(rough > _LAMBERT, _LAMBERT + (rough - _LAMBERT) * metal, rough)
    metal = metal[..., None]

    def albedo(table: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offset and slope of an albedo in the base colour."""
        black, white, metal_black, metal_white = (np.interp(level, _LEVELS, row)[..., None] for row in table)
        offset = (1 - metal) * black + metal * metal_black
        return offset, (1 - metal) * white + metal * metal_white - offset

    offset, slope = albedo(_our_albedo(), rough)
    other, other_slope = albedo(_principled_albedo(), theirs)
    color = (offset + slope * textures.linear_color - other) / np.maximum(other_slope, 1e-3)
    return Textures(to_display(color), np.uint8(theirs * 255 + 0.5), textures.metallic)


def _our_albedo() -> np.ndarray:
    """(4, levels) share of uniform light that our reflectance returns: black, white dielectric; black, white metal."""
    cos = np.sqrt((np.arange(64) + 0.5) / 64)  # as often as uniform light comes from there
    terms = [albedo_terms(cos, np.full(64, level)) for level in _LEVELS]
    a0, a1 = (np.array([term[k].mean() for term in terms]) for k in (0, 1))
    return np.stack([F0_DIELECTRIC * a0 + a1, 1 + F0_DIELECTRIC * a0 + a1, a1, a0 + a1])


@cache
def _principled_albedo() -> np.ndarray:
    """(4, levels) the same of ``principled``, measured."""
    rows = [[_measured(color, level, metallic) for level in _LEVELS] for metallic in (0.0, 1.0) for color in (0.0, 1.0)]
    return np.array(rows)


def _measured(color: float, roughness: float, metallic: float) -> float:
    made = mi.load_dict(
        {
            "type": "principled",
            "base_color": {"type": "rgb", "value": color},
            "roughness": float(roughness),
            "metallic": metallic,
            "specular": SPECULAR,
        }
    )
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, _SAMPLES)
    si = dr.zeros(mi.SurfaceInteraction3f, _SAMPLES)
    si.wi = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    _, weight = made.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    return float(np.array(weight.x).mean())


def _texture(values: np.ndarray) -> mi.Texture:
    """Bilinear texture of (h, w[, 3]) linear values."""
    data = np.ascontiguousarray(values if values.ndim == 3 else values[..., None], np.float32)
    return mi.load_dict({"type": "bitmap", "data": mi.TensorXf(data), "raw": True, "wrap_mode": "clamp"})


def _shape(piece: Piece, **children: Any) -> mi.Mesh:
    """Mesh with flat normals; bsdf and emitter as children."""
    props = mi.Properties()
    for key, child in children.items():
        props[key] = child
    mesh = piece.mesh
    count = len(mesh.vertices), len(mesh.triangles)
    made = mi.Mesh(piece.name, *count, has_vertex_normals=False, has_vertex_texcoords=True, props=props)
    params = mi.traverse(made)
    params["vertex_positions"] = mi.Float(np.ascontiguousarray(mesh.vertices, np.float32).ravel())
    params["faces"] = mi.UInt32(np.ascontiguousarray(mesh.triangles, np.uint32).ravel())
    params["vertex_texcoords"] = mi.Float(np.ascontiguousarray(piece.uv, np.float32).ravel())
    params.update()
    return made
