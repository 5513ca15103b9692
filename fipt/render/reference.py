"""Mitsuba's own path integrator on a textured mesh: the reference that our tracer is judged by.

It shares no estimator with our tracer: its BSDF is `fipt.render.bsdf`, its lights are Mitsuba's
area lights.
"""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations  # Mitsuba has no classes before its variant is set

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render import bsdf
from fipt.render.scene import vectors
from fipt.render.spots import Spot
from fipt.render.texels import DeviceMaps, MappedMesh, MappedSurface
from fipt.scene.cameras import Camera
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.scene.objects import MeshObject

_MAX_LANES = 2**22
"""Paths traced at once: bounds the memory of a wavefront."""

_FINER = 8
"""Texels of Mitsuba's environment maps along one of ours: the two are interpolated between different places."""

_MOST_ROWS = 2048
"""Rows that this refinement may lead to."""

_SHEET_GAP = 0.001
"""Distance between the two faces of a two-sided light, metres."""


@dataclass(frozen=True)
class EmittingMesh:
    """Triangles of one radiance.

    Attributes
    ----------
    mesh
        Its triangles, metres.
    radiance
        (3,) linear RGB; zero for an emitter that is off. Emitters absorb what falls on them.
    two_sided
        Emit from both sides. Mitsuba's area lights have one, so this makes two sheets, each triangle's moved along
        its normal; emitters whose back nobody can see, such as a closed globe, do without.
    """

    mesh: Mesh
    radiance: np.ndarray
    two_sided: bool = False


class SurfaceProbe:
    """What rays meet on a mesh, and the material there.

    Parameters
    ----------
    room
        The mesh; its triangles keep their numbers.
    """

    def __init__(self, room: MappedMesh) -> None:
        self._scene = mi.load_dict({"type": "scene", "mesh": _mesh("mesh", room.mesh, room.uv)})
        self._surface = MappedSurface(room)

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Trace rays.

        Parameters
        ----------
        origins, directions
            (N, 3) float32 in metres; unit directions.

        Returns
        -------
        distance
            (N,) float32 metres, infinite where a ray meets nothing.
        triangle
            (N,) int32, -1 where a ray meets nothing.
        """
        found = self._scene.ray_intersect_preliminary(_rays(origins, directions))
        distance, triangle = mi.Float(found.t), mi.Int32(found.prim_index)
        dr.eval(distance, triangle)
        distance = np.array(distance)
        return distance, np.where(np.isfinite(distance), np.array(triangle), -1)

    def materials(self, origins: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Trace rays and tell the material of what they meet.

        Returns
        -------
        dict
            ``triangle`` (N,) int32, -1 where a ray meets nothing; ``normal`` (N, 3) float32 unit geometric normal by
            winding order; ``base_color`` (N, 3), ``roughness`` and ``metallic`` (N,) float32, 0 where nothing is met.
        """
        si = self._scene.ray_intersect(_rays(origins, directions))
        valid = si.is_valid()
        triangle = dr.select(valid, mi.Int32(si.prim_index), -1)
        color = self._surface.base_color.eval(si, valid)
        roughness, metallic = (getattr(self._surface, name).eval_1(si, valid) for name in ("roughness", "metallic"))
        dr.eval(triangle, color, roughness, metallic, si.n)
        return {
            "triangle": np.array(triangle),
            "normal": np.array(si.n).T,
            "base_color": np.array(color).T,
            "roughness": np.array(roughness),
            "metallic": np.array(metallic),
        }


def load_scene(
    room: MappedMesh,
    emitters: Sequence[EmittingMesh],
    environment: EnvironmentMap = NOTHING,
    objects: Sequence[MeshObject] = (),
    spots: Sequence[Spot] = (),
) -> mi.Scene:
    """Make a scene to render.

    Parameters
    ----------
    room
        What reflects, T triangles (perhaps none); the emitters' triangles are not among them.
    emitters
        What emits.
    environment
        What comes from outside.
    objects, spots
        What else stands in the scene, each with materials of its own; lights at points.
    """
    scene: dict[str, Any] = {"type": "scene"}
    if len(room.mesh.triangles):
        scene["mesh"] = _mesh("mesh", room.mesh, room.uv, bsdf=bsdf.textured(MappedSurface(room)))
    for index, thing in enumerate(objects):
        mapped = MappedMesh(thing.mesh, thing.uv, DeviceMaps(thing.materials), thing.material)
        scene[f"object{index}"] = _mesh(f"object{index}", *_smooth(thing), bsdf=bsdf.textured(MappedSurface(mapped)))
    for index, spot in enumerate(spots):
        scene[f"spot{index}"] = _spot(spot)
    for index, emitter in enumerate(emitters):
        for side, sheet in enumerate(_sheets(emitter)):
            black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
            parts = {"bsdf": mi.load_dict(black)}
            if np.any(emitter.radiance):
                value = [float(c) for c in emitter.radiance]
                area = {"type": "area", "radiance": {"type": "rgb", "value": value}}
                parts["emitter"] = mi.load_dict(area)
            name = f"light{index}_{side}"
            scene[name] = _mesh(name, sheet, **parts)
    if environment.emits:
        scene["environment"] = _environment(environment)
    return mi.load_dict(scene)


class PathTracer:
    """Renders views of one scene with Mitsuba's ``path`` integrator.

    Rays leave from `Camera` itself and land evenly in a pixel: a pixel is the mean over its area. Paths of a pixel are
    stratified, in passes of square numbers: the fewer, the larger the image is.

    Parameters
    ----------
    scene
        From `load_scene`.
    max_depth
        Longest path, bounces.
    """

    def __init__(self, scene: mi.Scene, max_depth: int) -> None:
        self._scene = scene
        # Mitsuba counts a path's edges, one more than its bounces.
        self._integrator = mi.load_dict({"type": "path", "max_depth": max_depth + 1, "rr_depth": 5})

    def render(self, camera: Camera, spp: int, seed: int) -> np.ndarray:
        """Return the (H, W, 3) float32 radiance of a view from ``spp`` paths a pixel."""
        pixels = camera.width * camera.height
        # The passes depend on the image alone: the same seed gives the same image everywhere.
        counts = _squares(spp, max(_MAX_LANES // pixels, 1))
        seeds = np.random.SeedSequence(seed).generate_state(len(counts))
        total = np.zeros((pixels, 3))
        for count, pass_seed in zip(counts, seeds, strict=True):
            total += self._pass(camera, count, int(pass_seed))
        return (total / spp).reshape(camera.height, camera.width, 3).astype(np.float32)

    def _pass(self, camera: Camera, spp: int, seed: int) -> np.ndarray:
        """Return the (H * W, 3) sum of ``spp`` paths a pixel."""
        paths = camera.width * camera.height * spp
        sampler = mi.load_dict({"type": "stratified", "sample_count": spp})
        sampler.set_samples_per_wavefront(spp)
        sampler.seed(mi.UInt32(seed), paths)
        # Everything that differs between views is opaque, so that one kernel serves them all.
        width, count = (dr.opaque(mi.UInt32, n) for n in (camera.width, spp))
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        fx, fy, cx, cy = (dr.opaque(mi.Float, n) for n in intrinsics)
        right, up, back, center = (
            mi.Vector3f(*(dr.opaque(mi.Float, float(n)) for n in camera.world_from_camera[:3, k])) for k in range(4)
        )
        pixel = dr.arange(mi.UInt32, paths) // count
        row = pixel // width
        jitter = sampler.next_2d()
        x = (mi.Float(pixel - row * width) + jitter.x - cx) / fx
        y = (mi.Float(row) + jitter.y - cy) / fy
        direction = dr.normalize(x * right - y * up - back)
        ray = mi.RayDifferential3f(mi.Point3f(center), direction)
        color = mi.Color3f(self._integrator.sample(self._scene, sampler, ray)[0])
        dr.eval(color)
        # Sums of blocks, unlike a film's scatter-adds, come out the same to the bit every time.
        return np.stack([dr.block_reduce(dr.ReduceOp.Add, c, spp).numpy() for c in color], axis=1)


def _squares(total: int, most: int) -> list[int]:
    """Split a number into squares of at most ``most``, the largest first."""
    counts = []
    while total:
        counts.append(math.isqrt(min(total, most)) ** 2)
        total -= counts[-1]
    return counts


def _environment(environment: EnvironmentMap) -> dict[str, Any]:
    """Mitsuba's own emitter of an environment map.

    Its maps begin at -z, have their first and last rows at the poles and are not turned; ours is looked up where its
    texels are, on a grid finer than our own.
    """
    height, width = environment.radiance.shape[:2]
    if height == 1:
        return {"type": "constant", "radiance": {"type": "rgb", "value": environment.radiance[0, 0].tolist()}}
    finer = max(min(_FINER, _MOST_ROWS // height), 1)
    rows, columns = finer * height + 1, finer * width
    thetas = np.clip(np.linspace(0, np.pi, rows), 1e-4, np.pi - 1e-4)  # columns differ up to the poles
    phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    values = np.empty((rows, columns, 3), np.float32)
    for row, theta in enumerate(thetas):
        sine = np.sin(theta)
        directions = [sine * np.sin(phi), np.full(columns, np.cos(theta)), -sine * np.cos(phi)]
        values[row] = environment.lookup(np.stack(directions, axis=1))
    return {"type": "envmap", "bitmap": mi.Bitmap(values)}


def emitting_shape(name: str, mesh: Mesh, uv: np.ndarray, surface: Any) -> mi.Mesh:
    """Triangles that reflect by a BSDF and may emit, with texture coordinates (V, 2) float32 of their vertices."""
    area = {"type": "area", "radiance": {"type": "rgb", "value": 0.0}}
    return _mesh(name, mesh, uv, bsdf=surface, emitter=mi.load_dict(area))


def _sheets(emitter: EmittingMesh) -> list[Mesh]:
    """One-sided meshes that together make an emitter."""
    if not emitter.two_sided:
        return [emitter.mesh]
    corners = emitter.mesh.corners
    shift = 0.5 * _SHEET_GAP * emitter.mesh.normals[:, None]
    triangles = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return [
        Mesh((corners + shift).reshape(-1, 3), triangles),
        Mesh((corners - shift).reshape(-1, 3), triangles[:, ::-1]),
    ]


def _smooth(thing: MeshObject) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """Mesh, texture coordinates and normals of an object; corners are its own where triangles show flat normals."""
    corners = thing.mesh.triangles.reshape(-1)
    mesh = Mesh(thing.mesh.vertices[corners], np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    normals = thing.normals[corners]
    flat = ~normals.any(axis=1)
    normals[flat] = np.repeat(mesh.normals, 3, axis=0)[flat]
    return mesh, thing.uv[corners], normals


def _spot(spot: Spot) -> dict[str, Any]:
    """Mitsuba's own emitter of a spot."""
    at, axis = spot.position, spot.direction
    side = [0, 1, 0] if abs(axis[1]) < 0.9 else [1, 0, 0]
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(list(at), list(at + axis), side),
        "intensity": {"type": "rgb", "value": spot.intensity.tolist()},
        "cutoff_angle": float(np.degrees(spot.cutoff)),
        "beam_width": float(np.degrees(spot.beam)),
    }


def _rays(origins: np.ndarray, directions: np.ndarray) -> mi.Ray3f:
    return mi.Ray3f(vectors(np.atleast_2d(origins), mi.Point3f), vectors(np.atleast_2d(directions), mi.Vector3f))


def _mesh(
    name: str,
    mesh: Mesh,
    uv: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    **children: Any,
) -> mi.Mesh:
    """Make a mesh, with flat normals unless vertex normals are given, and bsdf or emitter as children."""
    props = mi.Properties()
    for key, child in children.items():
        props[key] = child
    made = mi.Mesh(
        name,
        len(mesh.vertices),
        len(mesh.triangles),
        has_vertex_normals=normals is not None,
        has_vertex_texcoords=uv is not None,
        props=props,
    )
    params = mi.traverse(made)
    params["vertex_positions"] = mi.Float(np.ascontiguousarray(mesh.vertices, np.float32).ravel())
    params["faces"] = mi.UInt32(np.ascontiguousarray(mesh.triangles, np.uint32).ravel())
    if uv is not None:
        params["vertex_texcoords"] = mi.Float(np.ascontiguousarray(uv, np.float32).ravel())
    if normals is not None:
        params["vertex_normals"] = mi.Float(np.ascontiguousarray(normals, np.float32).ravel())
    params.update()
    return made
