"""The mesh cut along edges of radiance, so that what emits and what does not share no triangle."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from fipt.meshing.radiance_edges import RadianceEdges
from fipt.meshing.subdivide import split_sides, subdivided
from fipt.meshing.topology import border_vertices, side_list
from fipt.scene.mesh import Mesh

SIDE = 2.0
"""Longest side in footprints of triangles that an edge runs through: it is straight within one, so that a curve of
radius r lies beside it by 1 / (2 r), all in footprints."""
_MOST = 400_000
"""Triangles that a cut may add: a room full of texture is cut coarser, so that later stages take no longer than with a
mesh that was not decimated."""
_NEAREST = 12
"""Edge points that a straight piece of an edge is fitted to: a few views with a point each pixel."""
_REACH = 1.0
"""Distance in footprints within which they must lie, twice the error of a place that one view tells."""
_SNAP = 0.25
"""Distance from the edge, as a share of the shortest side at a vertex, within which the vertex is moved onto it."""
_FLAT = np.cos(np.radians(5.0))
"""Cosine of the bend at a vertex above which it may be moved: creases stay where they are."""


def cut_at(mesh: Mesh, edges: RadianceEdges) -> Mesh:
    """Cut a mesh along radiance edges.

    Triangles that an edge runs through are halved until their sides are below `SIDE` footprints, near vertices are
    moved onto the edge, and sides that still cross it are split where they do.
    """
    if len(edges) < _NEAREST:
        return mesh
    curve, side = _Curve.of(edges), SIDE
    while True:
        fine = subdivided(mesh, partial(_too_large, curve, side))
        if len(fine.triangles) <= len(mesh.triangles) + _MOST:
            return _split(_snapped(fine, curve), curve)
        side *= 2


def _too_large(curve: "_Curve", side: float, mesh: Mesh) -> np.ndarray:
    """(T,) bool: triangles that the edge may run through with sides of more than ``side`` footprints."""
    corners = mesh.corners.astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    center = corners.mean(axis=1)
    radius = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    result = longest > side * curve.footprint.min()
    distance, index = curve.tree.query(center[result], workers=-1)
    result[result] = (longest[result] > side * curve.footprint[index]) & (distance < radius[result])
    return result


@dataclass(frozen=True)
class _Curve:
    """Edge points in a tree, with footprints (N,) averaged over neighbours: several views see an edge."""

    tree: cKDTree
    position: np.ndarray
    footprint: np.ndarray

    @staticmethod
    def of(edges: RadianceEdges) -> "_Curve":
        tree = cKDTree(edges.position)
        near = tree.query(edges.position, k=_NEAREST, workers=-1)[1]
        return _Curve(tree, edges.position, edges.footprint[near].mean(axis=1))

    def line(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place (M, 3) and direction (M, 3) of the edge near points, and (M,) whether there is one."""
        distance, index = self.tree.query(points, k=_NEAREST, workers=-1)
        size = self.footprint[index[:, 0]]
        weight = np.maximum(1.0 - (distance / (_REACH * size[:, None])) ** 2, 0.0)
        known = (weight > 0).sum(axis=1) >= 3
        weight[~known] = 1.0
        weight /= weight.sum(axis=1, keepdims=True)
        near = self.position[index]
        middle = (weight[:, :, None] * near).sum(axis=1)
        away = near - middle[:, None]
        values, vectors = np.linalg.eigh(np.einsum("mk,mki,mkj->mij", weight, away, away))
        # a heap of points without a direction is no edge: a corner, or texture
        return middle, vectors[:, :, 2], known & (values[:, 2] > 4 * values[:, 1])


def _snapped(mesh: Mesh, curve: _Curve) -> Mesh:
    """Move vertices of flat surface that lie close to the edge onto it, where no triangle turns over."""
    ends, _ = side_list(mesh.triangles)
    places = mesh.vertices.astype(np.float64)
    length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    shortest = np.full(len(places), np.inf)
    for column in ends.T:
        np.minimum.at(shortest, column, length)
    normals = mesh.normals.astype(np.float64)
    mean = np.zeros_like(places)
    for corner in mesh.triangles.T:
        np.add.at(mean, corner, normals)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30)
    flat = ~border_vertices(mesh)
    for corner in mesh.triangles.T:
        np.logical_and.at(flat, corner, (normals * mean[corner]).sum(axis=1) > _FLAT)
    near = np.flatnonzero(flat)
    near = near[
        curve.tree.query(places[near], distance_upper_bound=float(curve.footprint.max()), workers=-1)[0] < np.inf
    ]
    middle, along, known = curve.line(places[near])
    across = np.cross(along, mean[near])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    off = ((middle - places[near]) * across).sum(axis=1)
    chosen = known & (np.abs(off) < _SNAP * shortest[near])
    moved = places.copy()
    moved[near[chosen]] += off[chosen, None] * across[chosen]
    turned = (Mesh(moved, mesh.triangles).area_normals * normals).sum(axis=1) < 0.2 * mesh.areas
    moved[mesh.triangles[turned]] = places[mesh.triangles[turned]]
    return Mesh(moved.astype(np.float32), mesh.triangles)


def _split(mesh: Mesh, curve: _Curve) -> Mesh:
    """Split the sides of triangles where they cross the edge."""
    ends, side = side_list(mesh.triangles)
    places = mesh.vertices.astype(np.float64)
    a, b = places[ends[:, 0]], places[ends[:, 1]]
    length = np.linalg.norm(a - b, axis=1)
    center = 0.5 * (a + b)
    distance, index = curve.tree.query(center, workers=-1)
    near = np.flatnonzero(distance < 0.5 * length + 0.5 * curve.footprint[index])
    normal = np.zeros_like(a)
    for column in side.T:
        np.add.at(normal, column, mesh.normals)
    middle, along, known = curve.line(center[near])
    across = np.cross(along, normal[near])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    from_a = ((a[near] - middle) * across).sum(axis=1)
    from_b = ((b[near] - middle) * across).sum(axis=1)
    share = from_a / np.where(np.abs(from_a - from_b) > 1e-12, from_a - from_b, 1.0)
    crosses = known & (from_a * from_b < 0) & (share > _SNAP * 0.5) & (share < 1 - _SNAP * 0.5)
    where = np.full(len(ends), np.nan)
    where[near[crosses]] = share[crosses]
    return split_sides(mesh, ends, side, where)
