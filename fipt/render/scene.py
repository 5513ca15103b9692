"""The mesh as Mitsuba sees it: rays in, distances and triangles out."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.conventions import RAY_EPSILON
from fipt.scene.mesh import Mesh

_DIRECTIONS = 256
"""Rays around a place that tell how far a room reaches: 10 degrees apart, and it counts by halves."""
_NEAR = 0.99
"""Share of what is seen that is the room, as `fipt.scene.samples.scene_box` has it."""
_ALIGNMENT = 128
"""Bytes: at least what any processor's vector registers hold."""


def lanes(array: np.ndarray, kind: type) -> Any:
    """Turn an (N,) array of the type's dtype into a Dr.Jit type.

    NumPy's memory starts anywhere and Dr.Jit reads it in place: each new combination of aligned and unaligned inputs
    compiles the kernel again, some 50 ms. So the values are copied to where all inputs are aligned.
    """
    memory = np.empty(array.nbytes + 2 * _ALIGNMENT, np.uint8)  # the last load is that of a whole register, too
    start = -memory.ctypes.data % _ALIGNMENT
    aligned = memory[start : start + array.nbytes].view(array.dtype)
    aligned[:] = array
    return kind(aligned)


def vectors(array: np.ndarray, kind: type) -> Any:
    """Turn an (N, 3) array into a Dr.Jit point, vector or colour type."""
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"must have shape (N, 3), got {array.shape}")
    return kind(*(lanes(column, type(kind().x)) for column in array.astype(np.float32).T))


def _bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (3,) float64 of points (N, 3)."""
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)


class RayScene:
    """A mesh to trace rays against.

    Attributes
    ----------
    scene
        The Mitsuba scene; its only shape is the mesh.
    normals
        (T, 3) float32 geometric normals by winding order.
    extent
        Longest side of the bounds of the triangles, metres; of what is seen from where cameras stand, if these are
        known and that is less than half of it. A ground or an object far away does not set the scale of a room.
    middle
        (3,) centre of these bounds, metres.
    epsilon
        Offset of ray origins along the normal inside these bounds, metres.
    """

    def __init__(self, mesh: Mesh) -> None:
        shape = mi.Mesh(
            "room",
            len(mesh.vertices),
            len(mesh.triangles),
            has_vertex_normals=False,
            has_vertex_texcoords=False,
        )
        parameters = mi.traverse(shape)
        parameters["vertex_positions"] = mi.Float(mesh.vertices.astype(np.float32).ravel())
        parameters["faces"] = mi.UInt32(mesh.triangles.astype(np.uint32).ravel())
        parameters.update()
        self.scene = mi.load_dict({"type": "scene", "room": shape})
        self.normals = mesh.normals
        low, high = _bounds(mesh.vertices[np.unique(mesh.triangles)])
        if mesh.seen_from is not None and len(mesh.seen_from):
            near = self._nearest(mesh.seen_from)
            seen = _bounds(near) if len(near) else (low, high)
            if np.ptp(seen, axis=0).max() < np.ptp((low, high), axis=0).max() / 2:
                low, high = seen
        self.middle, self.extent = (low + high) / 2, float((high - low).max())
        self.epsilon = float(RAY_EPSILON * self.extent)

    def offset(self, points: "mi.Point3f") -> "mi.Float":
        """Offset of rays from points (N,): `epsilon`, more as far outside the bounds as positions are coarser there."""
        away = dr.abs(points - mi.Point3f(*map(float, self.middle)))
        return self.epsilon * dr.maximum(1.0, dr.max(away) / max(self.extent, 1e-30))

    def _nearest(self, places: np.ndarray) -> np.ndarray:
        """(N, 3) points that are seen from places (P, 3) all around, but for the farthest hundredth."""
        k = np.arange(_DIRECTIONS) + 0.5
        polar, azimuth = np.arccos(1 - 2 * k / _DIRECTIONS), np.pi * (1 + 5**0.5) * k
        around = np.column_stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)])
        origins = np.repeat(places, _DIRECTIONS, axis=0)
        directions = np.tile(around, (len(places), 1)).astype(np.float32)
        distance, triangle = self.intersect(origins, directions)
        met = triangle >= 0
        points = origins[met] + distance[met, None] * directions[met].astype(np.float64)
        return points[distance[met] <= np.quantile(distance[met], _NEAR)] if met.any() else points

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find what rays meet first.

        Parameters
        ----------
        origins
            (N, 3) or (3,) float32, metres.
        directions
            (N, 3) float32 unit vectors.

        Returns
        -------
        distance
            (N,) float32 metres, infinite where nothing is met.
        triangle
            (N,) int32, -1 where nothing is met.
        """
        if len(directions) == 0:  # an empty array of rays crashes the library
            return np.zeros(0, np.float32), np.zeros(0, np.int32)
        d = vectors(directions, mi.Vector3f)
        o = mi.Point3f(*map(float, origins)) if origins.ndim == 1 else vectors(origins, mi.Point3f)
        found = self.scene.ray_intersect_preliminary(mi.Ray3f(o, d), coherent=True)
        valid = found.is_valid()
        distance = dr.select(valid, found.t, dr.inf)
        triangle = dr.select(valid, mi.Int32(found.prim_index), -1)
        dr.eval(distance, triangle)
        return distance.numpy(), triangle.numpy().astype(np.int32)
