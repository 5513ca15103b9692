"""Objects and mesh lights of a setup in their places; objects that are dropped fall onto what is below."""

import logging
from dataclasses import replace

import numpy as np

from fipt.errors import FiptError
from fipt.render.scene import RayScene
from fipt.scene.mesh import Mesh
from fipt.scene.objects import MeshObject, moved, read_object, shape_object
from fipt.scene.setup import MeshLight, NewObject

log = logging.getLogger(__name__)

_GAP = 0.0005
"""Air left below a dropped object, metres: surfaces that touch would hide from each other's rays."""


def turned(rotation: tuple[float, float, float]) -> np.ndarray:
    """(3, 3) rotation by degrees about the world's x, then y, then z axis."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", rotation, degrees=True).as_matrix()


def light_mesh(light: MeshLight) -> Mesh:
    """Triangles of a mesh light, in its place."""
    return _placed(read_object(light.file), light).mesh


def objects_in(room: Mesh, entries: tuple[NewObject, ...], up: str) -> list[MeshObject]:
    """Objects of a setup in their places, with their materials; what is dropped falls onto the room and what is before.

    Parameters
    ----------
    room
        Everything else.
    up
        Axis that points up, ``y`` or ``z``.
    """
    placed = []
    for number, entry in enumerate(entries):
        made = shape_object(entry.shape, entry.size) if entry.shape else read_object(str(entry.file))
        thing = _placed(made.changed(entry.base_color, entry.roughness, entry.metallic), entry)
        if entry.drop:
            thing = _dropped(thing, room, "xyz".index(up), f"objects.{number}")
        placed.append(thing)
        room = appended(room, thing.mesh)
    return placed


def appended(mesh: Mesh, *others: Mesh) -> Mesh:
    """``mesh`` with others' triangles after its own."""
    starts = np.cumsum([len(mesh.vertices)] + [len(other.vertices) for other in others])
    shifted = [other.triangles + start for other, start in zip(others, starts, strict=False)]
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, *(other.vertices.astype(np.float32) for other in others)]),
        triangles=np.concatenate([mesh.triangles, *(triangles.astype(np.int32) for triangles in shifted)]),
    )


def barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners (N, 3, 3) of triangles at points near them, none negative, sum 1."""
    corners, points = corners.astype(np.float64), points.astype(np.float64)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    uu, uv, vv = (np.einsum("nk,nk->n", x, y) for x, y in ((u, u), (u, v), (v, v)))
    pu, pv = (np.einsum("nk,nk->n", points - a, x) for x in (u, v))
    scale = np.maximum(uu * vv - uv**2, 1e-300)
    second, third = (vv * pu - uv * pv) / scale, (uu * pv - uv * pu) / scale
    weights = np.clip(np.stack([1 - second - third, second, third], axis=1), 0, 1)
    return weights / weights.sum(axis=1, keepdims=True)


def _placed(thing: MeshObject, entry: MeshLight | NewObject) -> MeshObject:
    matrix, shift = entry.scale * turned(entry.rotation), np.array(entry.position)
    vertices, normals = moved(thing.mesh.vertices, thing.normals, matrix, shift)
    mesh = Mesh(vertices, thing.mesh.triangles)
    return MeshObject(mesh, normals, thing.uv, thing.materials, thing.material)


def _dropped(thing: MeshObject, room: Mesh, up: int, name: str) -> MeshObject:
    """Move an object down until one of its corners meets the room, or one of the room's corners meets it."""
    down = np.zeros(3, np.float32)
    down[up] = -1
    around = [axis for axis in range(3) if axis != up]
    own = thing.mesh.vertices
    low, high = own.min(axis=0), own.max(axis=0)
    there = room.vertices[np.unique(room.triangles[room.areas > 0])]  # not of what was removed
    below = (there[:, around] >= low[around]) & (there[:, around] <= high[around])
    below = there[below.all(axis=1) & (there[:, up] < high[up])]
    falls = [RayScene(room).intersect(own, np.tile(down, (len(own), 1)))[0]]
    if len(below):
        falls.append(RayScene(thing.mesh).intersect(below, np.tile(-down, (len(below), 1)))[0])
    fall = float(np.concatenate(falls).min())
    if not np.isfinite(fall):
        raise FiptError(f"{name} cannot be dropped: nothing is below it", "change its position")
    shift = down * max(fall - _GAP, 0.0)
    log.info("%s falls %.2f m, to %.2f m", name, -shift[up], low[up] + shift[up])
    mesh = Mesh(own + shift, thing.mesh.triangles)
    return MeshObject(mesh, thing.normals, thing.uv, thing.materials, thing.material)
