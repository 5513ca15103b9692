"""Exported rooms in Mitsuba: what other programs show of them, and the reflectance that they have for it."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations  # Mitsuba has no classes before its variant is set

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.formats.images import to_display
from fipt.model.albedo import albedo_terms
from fipt.render import bsdf
from fipt.render.footprint import sub_pixel_points
from fipt.render.scene import lanes
from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh, mitsuba_map
from fipt.scene.cameras import Camera

SPECULAR = 0.2
"""Mitsuba's ``specular`` of dielectrics. 0.5 reflects 0.04 straight on, as ours; but its highlights lose nothing at
grazing angles. With this value black dielectrics return about as much of uniform light as ours, between roughness 0.2
and 0.65: highlights are dimmer straight on, and brighter at grazing angles. It holds for the whole scene."""

_LAMBERT = 0.65
"""Roughness at which Mitsuba's diffuse lobe is nearest to Lambert's (of directional albedos)."""

_LEVELS = np.linspace(ROUGHNESS_MIN, 1.0, 12)
_SAMPLES = 2**16
_MAX_LANES = 2**22  # paths traced at once


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
    for emitter in asset.sheets:
        parts = {"bsdf": mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})}
        if emitter.radiance.any():
            value = [float(v) for v in emitter.radiance]
            parts["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": value}})
        scene[emitter.name] = _shape(emitter, **parts)
    if asset.outside.emits:
        scene["outside"] = {"type": "envmap", "bitmap": mi.Bitmap(mitsuba_map(asset.outside))}
    return mi.load_dict(scene)


def guides(scene: mi.Scene, asset: Asset, camera: Camera, grid: int) -> tuple[np.ndarray, np.ndarray]:
    """Base colour and normal (H, W, 3) that a view shows, free of noise, for the denoiser; ``scene`` is the asset's.

    Both are means over the rays of a pixel, emitters black: only what is reflected is denoised.
    """
    color = _texture(asset.textures.linear_color)
    surface = mi.ShapePtr(next(shape for shape in scene.shapes() if shape.id() == asset.surface.name))

    def seen(ray: mi.Ray3f) -> list[mi.Color3f]:
        si = scene.ray_intersect(ray)
        base = dr.select(si.is_valid() & (si.shape == surface), color.eval(si), 0.0)
        return [base, dr.select(si.is_valid(), mi.Color3f(si.n), 0.0)]

    base, normal = _mean_over_rays(rays_of(camera), (camera.height, camera.width), grid, seen)
    return base, normal


def emitted(scene: mi.Scene, rays: Rays, shape: tuple[int, int], grid: int) -> np.ndarray:
    """(H, W, 3) radiance of emitters and the outside that a view shows directly, through the rays of `traced_image`."""

    def seen(ray: mi.Ray3f) -> list[mi.Color3f]:
        si = scene.ray_intersect(ray)
        return [mi.Color3f(si.emitter(scene).eval(si))]

    return _mean_over_rays(rays, shape, grid, seen)[0]


def _mean_over_rays(
    rays: Rays, shape: tuple[int, int], grid: int, seen: Callable[[mi.Ray3f], list[mi.Color3f]]
) -> list[np.ndarray]:
    """(H, W, 3) float32 means over each pixel's grid^2 rays of what is seen along them."""
    rows, columns = np.indices(shape, np.float32).reshape(2, -1)
    total: np.ndarray | float = 0.0
    for x, y in sub_pixel_points(grid**2):
        colors = seen(rays(*(lanes(values, mi.Float) for values in (columns + np.float32(x), rows + np.float32(y)))))
        total = total + np.array([np.array(color).T for color in colors], np.float64)
    return [(values / grid**2).reshape(*shape, 3).astype(np.float32) for values in total]


def load_scene_file(path: Path) -> mi.Scene:
    """Load a Mitsuba scene file that was exported.

    Raises
    ------
    FiptError
        If Mitsuba cannot read it.
    """
    bsdf.register()  # scene_exact.xml asks for it; a user imports fipt_bsdf.py instead
    try:
        # otherwise shapes come in another order each time, and images have other noise
        return mi.load_file(str(path), parallel=False, optimize=False)
    except RuntimeError as error:
        raise FiptError(f"Mitsuba cannot load {path} ({error})", "export it again") from error


def path_integrator(max_depth: int) -> mi.Integrator:
    """Mitsuba's path tracer; ``max_depth`` counts bounces, one less than a path has edges."""
    return mi.load_dict({"type": "path", "max_depth": max_depth + 1})


Rays = Callable[[Any, Any], Any]
"""Rays of a camera (mi.Ray3f) through image coordinates (mi.Float), columns and rows in pixels."""


def rays_of(camera: Camera) -> Rays:
    """Rays of one of our cameras."""
    pose, inner = camera.world_from_camera, (camera.fx, camera.fy, camera.cx, camera.cy)
    # opaque: one kernel serves all views
    right, up, backward, center = (
        mi.Vector3f(*(dr.opaque(mi.Float, float(value)) for value in pose[:3, k])) for k in range(4)
    )
    fx, fy, cx, cy = (dr.opaque(mi.Float, float(value)) for value in inner)

    def rays(column: mi.Float, row: mi.Float) -> mi.Ray3f:
        x, y = (column - cx) / fx, (row - cy) / fy
        return mi.Ray3f(mi.Point3f(center), dr.normalize(x * right - y * up - backward))

    return rays


def rays_of_sensor(scene: mi.Scene, number: int) -> Rays:
    """Rays of a camera that a scene file defines."""
    sensor = scene.sensors()[number]
    width, height = sensor.film().size()

    def rays(column: mi.Float, row: mi.Float) -> mi.Ray3f:
        place = mi.Point2f(column / width, row / height)
        return mi.Ray3f(sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))[0])

    return rays


def traced_image(
    scene: mi.Scene, integrator: mi.Integrator, rays: Rays, shape: tuple[int, int], grid: int, spp: int, seed: int
) -> np.ndarray:
    """Path trace a view of a scene.

    Parameters
    ----------
    shape
        Height and width, pixels.
    grid
        A pixel is looked through by the square of this many rays, the same as of our own pictures: where a lamp borders
        on something dark, a pixel depends much on where in it one looks.
    spp
        Paths a pixel, rounded up to a multiple of its rays.

    Returns
    -------
    (H, W, 3) float32 radiance.
    """
    height, width = shape
    pixels, places = height * width, sub_pixel_points(grid**2)
    each = -(-spp // len(places))
    most = max(_MAX_LANES // pixels, 1)
    passes = [(place, min(most, each - first)) for place in places for first in range(0, each, most)]
    sampler = mi.load_dict({"type": "independent"})
    total = np.zeros((pixels, 3))
    seeds = np.random.SeedSequence(seed).generate_state(len(passes))
    for ((x, y), count), number in zip(passes, seeds, strict=True):
        # opaque: one kernel serves all passes
        sampler.seed(dr.opaque(mi.UInt32, int(number)), pixels * count)
        dx, dy = dr.opaque(mi.Float, float(x)), dr.opaque(mi.Float, float(y))
        pixel = dr.arange(mi.UInt32, pixels * count) // dr.opaque(mi.UInt32, count)
        row = pixel // width
        ray = rays(mi.Float(pixel - row * width) + dx, mi.Float(row) + dy)
        color = mi.Color3f(integrator.sample(scene, sampler, mi.RayDifferential3f(ray))[0])
        dr.eval(color)
        total += np.stack([dr.block_reduce(dr.ReduceOp.Add, c, count).numpy() for c in color], axis=1)
    return (total / (each * len(places))).reshape(height, width, 3).astype(np.float32)


def principled_textures(textures: MaterialTextures) -> MaterialTextures:
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
    return MaterialTextures(to_display(color), np.uint8(theirs * 255 + 0.5), textures.metallic)


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


def _shape(piece: TexturedMesh, **children: Any) -> mi.Mesh:
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
