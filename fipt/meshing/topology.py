"""Which triangles touch, and what is broken about how they do."""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from fipt.groups import connected_groups
from fipt.scene.mesh import Mesh


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First index (K,) of each different row of (N, 3), and (N,) which of them each row is; faster than np.unique."""
    order = np.lexsort(rows.T)  # stable: of equal rows the first comes first
    new = np.ones(len(rows), bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    which = np.empty(len(rows), np.int64)
    which[order] = np.cumsum(new) - 1
    return order[new], which


def triangle_sides(triangles: np.ndarray) -> np.ndarray:
    """(T, 3) int64 key of each triangle's sides (corners 0-1, 1-2, 2-0); equal keys are one edge of the mesh."""
    a = triangles.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    return np.minimum(a, b) << 32 | np.maximum(a, b)


def side_list(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(E, 2) vertices of every edge of the mesh, and (T, 3) the edge of each triangle's sides 0-1, 1-2, 2-0."""
    keys, side = np.unique(triangle_sides(triangles), return_inverse=True)
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1), side.reshape(-1, 3)


def neighbours(triangles: np.ndarray) -> np.ndarray:
    """(P, 2) int64 pairs of triangles that share an edge; of an edge of more than two, those next in order."""
    keys = triangle_sides(triangles).ravel()
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    return np.stack([order[same] // 3, order[same + 1] // 3], axis=1)


def vertex_links(mesh: Mesh) -> csr_matrix:
    """(V, V) sparse matrix, 1 where two vertices share an edge."""
    a = mesh.triangles.astype(np.int64)
    rows, columns = a.ravel(), np.roll(a, -1, axis=1).ravel()
    count = len(mesh.vertices)
    links = coo_matrix((np.ones(len(rows), np.float32), (rows, columns)), shape=(count, count))
    links = (links + links.T).tocsr()
    links.data[:] = 1.0
    return links


def border_vertices(mesh: Mesh) -> np.ndarray:
    """(V,) bool: vertices of an edge that only one triangle has."""
    keys, count = np.unique(triangle_sides(mesh.triangles), return_counts=True)
    open_edges = keys[count == 1]
    border = np.zeros(len(mesh.vertices), bool)
    border[open_edges >> 32] = border[open_edges & 0xFFFFFFFF] = True
    return border


def pieces(mesh: Mesh) -> np.ndarray:
    """(T,) int64 number of the piece of each triangle: triangles that share a vertex are of one piece."""
    a = mesh.triangles
    rows, columns = a[:, [0, 1]].ravel(), a[:, [1, 2]].ravel()
    return connected_groups((rows, columns), len(mesh.vertices))[a[:, 0]]


def compact(vertices: np.ndarray, triangles: np.ndarray) -> Mesh:
    """Return a mesh of these triangles without vertices that none of them uses."""
    used = np.zeros(len(vertices), bool)
    used[triangles] = True
    number = np.cumsum(used) - 1
    return Mesh(vertices[used].astype(np.float32), number[triangles].astype(np.int32))
