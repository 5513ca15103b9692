"""The last touch to a mesh: vertices near the room's planes are put onto them, and onto their lines and corners."""

import numpy as np

from fipt.meshing.planes import Planes, flattened
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.room_planes import RoomPlanes

_TURNED = np.cos(np.radians(15.0))
"""Cosine within which a triangle may lie on a plane: smoothed surface beside a crease is turned by less."""
_PLANES = 16
"""Planes that triangles are held against at once: a bound on memory."""


def planes_of(mesh: Mesh, planes: RoomPlanes, within: float) -> np.ndarray:
    """(T,) int64 the room's plane that each triangle lies on, the nearest; -1 for none.

    Parameters
    ----------
    within
        Metres up to which all corners of a triangle may lie beside a plane.
    """
    nearest, of = np.full(len(mesh.triangles), np.inf), np.full(len(mesh.triangles), -1, np.int64)
    vertices, normals = mesh.vertices.astype(np.float64), mesh.normals.astype(np.float64)
    for first in range(0, len(planes), _PLANES):
        chosen = slice(first, first + _PLANES)
        off = np.abs(vertices @ planes.normal[chosen].T - planes.offset[chosen])
        worst = off[mesh.triangles].max(axis=1)
        worst = np.where(normals @ planes.normal[chosen].T > _TURNED, worst, np.inf)
        best, away = worst.argmin(axis=1), worst.min(axis=1)
        nearer = (away < within) & (away < nearest)
        nearest, of = np.where(nearer, away, nearest), np.where(nearer, first + best, of)
    return of


def snapped(mesh: Mesh, planes: RoomPlanes, within: float) -> tuple[Mesh, np.ndarray]:
    """Put vertices onto the planes of their triangles, and onto the lines and points where these meet.

    Returns the mesh, and the (T,) int64 plane of each triangle, -1 for none. A triangle whose vertices would turn it
    over keeps them.
    """
    of = planes_of(mesh, planes, within)
    on = Planes(planes.normal, planes.offset, of.astype(np.int32))
    moved = flattened(mesh, on, within)
    # thin triangles may be turned over: their vertices stay
    bad = ((moved.normals * mesh.normals).sum(axis=1) < 0) & (mesh.areas > 0)
    if bad.any():
        stay = np.unique(mesh.triangles[bad])
        vertices = moved.vertices.copy()
        vertices[stay] = mesh.vertices[stay]
        moved = Mesh(vertices, mesh.triangles)
    return moved, of
