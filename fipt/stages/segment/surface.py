"""The surface as a graph of cells: who touches whom, smooth regions, what is near."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from fipt.groups import connected_groups
from fipt.scene.mesh import Mesh

_TIDY_PASSES = 4
"""Islands within islands that are cleaned."""
_WEAK = 0.5
"""Mean agreement below which a small piece is an island although its segment has no larger one."""


@dataclass(frozen=True)
class CellSurface:
    """Cells and their neighbours; two are neighbours where they share a side, wherever their corners are listed.

    Attributes
    ----------
    center
        (C, 3) float64 centroids, metres.
    area
        (C,) float64 square metres.
    pairs
        (E, 2) int64 neighbours, each pair once.
    border
        (E,) float64 length of the side that they share, metres.
    bend
        (E,) float64 cosine of the angle by which the surface turns there: 1 flat, 0 a square edge, -1 folded back.
    """

    center: np.ndarray
    area: np.ndarray
    pairs: np.ndarray
    border: np.ndarray
    bend: np.ndarray

    def __len__(self) -> int:
        return len(self.area)

    def graph(self, chosen: np.ndarray, weight: np.ndarray) -> csr_matrix:
        """(C, C) symmetric matrix of ``weight`` (E,) over the ``chosen`` (E,) pairs."""
        a, b = self.pairs[chosen].T
        return csr_matrix((np.tile(weight[chosen], 2), (np.r_[a, b], np.r_[b, a])), shape=(len(self),) * 2)

    def pieces(self, chosen: np.ndarray) -> np.ndarray:
        """(C,) int64 connected piece of each cell, over the ``chosen`` (E,) pairs."""
        return connected_groups(self.pairs[chosen].T, len(self))


def surface_of(mesh: Mesh) -> CellSurface:
    """Find the neighbours of all triangles of a mesh, in time in proportion to their number (but for one sort)."""
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.triangles].astype(np.int64)
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    key = ends[:, 0] << 32 | ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = (key[order[1:]] == key[order[:-1]]) & (ends[order[1:], 0] != ends[order[1:], 1])
    sides = np.stack([order[:-1][same], order[1:][same]], axis=1)
    pairs = sides // 3
    distinct = pairs[:, 0] != pairs[:, 1]
    sides, pairs = sides[distinct], pairs[distinct]
    points = mesh.corners.astype(np.float64)
    # of each side, the direction within its triangle that leads away from it
    start = points[pairs, sides % 3]
    along = points[pairs[:, 0], (sides[:, 0] + 1) % 3] - start[:, 0]
    border = np.linalg.norm(along, axis=1)
    along /= np.maximum(border, 1e-30)[:, None]
    away = points[pairs, (sides % 3 + 2) % 3] - start
    away -= (away * along[:, None]).sum(axis=2, keepdims=True) * along[:, None]
    away /= np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-30)
    return CellSurface(points.mean(axis=1), mesh.areas, pairs, border, -(away[:, 0] * away[:, 1]).sum(axis=1))


def filled(surface: CellSurface, ids: np.ndarray, smooth: np.ndarray) -> np.ndarray:
    """(C,) ids whose zeros take the id of the nearest cell that has one, along the surface over ``smooth`` (E,) pairs.

    What no such way leads to stays 0.
    """
    known = np.flatnonzero(ids > 0)
    if len(known) in (0, len(ids)):
        return ids
    far = np.linalg.norm(surface.center[surface.pairs[:, 0]] - surface.center[surface.pairs[:, 1]], axis=1)
    graph = surface.graph(smooth, np.maximum(far, 1e-9))
    source = dijkstra(graph, directed=True, indices=known, min_only=True, return_predecessors=True)[2]
    result = ids.copy()
    reached = (ids == 0) & (source >= 0)
    result[reached] = ids[source[reached]]
    return result


def tidied(
    surface: CellSurface, ids: np.ndarray, agreement: np.ndarray, smallest: float, smooth: np.ndarray | None = None
) -> np.ndarray:
    """(C,) ids of which small islands took the id of the neighbour that they share the longest border with.

    An island is a connected piece below ``smallest`` square metres that is not its segment's largest piece, or whose
    votes disagree: ``agreement`` (C,) in [0, 1]. Islands without neighbours stay. ``smooth`` (E,) limits the borders
    that count.
    """
    a, b = surface.pairs.T
    for _ in range(_TIDY_PASSES):
        piece = surface.pieces(ids[a] == ids[b])
        area = np.bincount(piece, surface.area)
        owner = np.zeros(len(area), ids.dtype)
        owner[piece] = ids
        largest = np.zeros(int(ids.max(initial=0)) + 1)
        np.maximum.at(largest, owner, area)
        trust = np.bincount(piece, surface.area * agreement) / np.maximum(area, 1e-30)
        island = (area < smallest) & (owner > 0) & ((area < largest[owner]) | (trust < _WEAK))
        border = (piece[a] != piece[b]) & (True if smooth is None else smooth)
        # both ways round: from an island to the id beside it
        own, other = np.r_[piece[a[border]], piece[b[border]]], np.r_[ids[b[border]], ids[a[border]]]
        beside = np.r_[piece[b[border]], piece[a[border]]]
        length = np.tile(surface.border[border], 2)
        usable = island[own] & (other > 0) & ~(island[beside] & (area[beside] <= area[own]))
        if not usable.any():
            return ids
        key, place = np.unique(own[usable].astype(np.int64) << 32 | other[usable].astype(np.int64), return_inverse=True)
        shared = np.bincount(place.reshape(-1), length[usable])
        order = np.argsort(shared, kind="stable")
        taken = owner.copy()
        taken[key[order] >> 32] = key[order] & 0xFFFFFFFF  # the last write, with the longest border, stays
        ids = taken[piece]
    return ids


def near_pieces(surface: CellSurface, ids: np.ndarray, gap: float) -> np.ndarray:
    """(C,) int64 number of the piece of its segment that each cell belongs to, -1 where its id is 0.

    Cells are of one piece where a chain of touching cells of their segment joins them, or of cells nearer than about
    ``gap`` metres: the legs of a chair belong to its seat.
    """
    known = np.flatnonzero(ids > 0)
    result = np.full(len(ids), -1, np.int64)
    if len(known) == 0:
        return result
    cell = np.floor((surface.center[known] - surface.center[known].min(axis=0)) / (gap / 2)).astype(np.int64)
    span = cell.max(axis=0) + 2
    segment = ids[known].astype(np.int64)
    voxel = ((segment * span[0] + cell[:, 0]) * span[1] + cell[:, 1]) * span[2] + cell[:, 2]
    keys, node = np.unique(voxel, return_inverse=True)
    node_of = np.full(len(ids), -1, np.int64)
    node_of[known] = node.reshape(-1)
    a, b = surface.pairs.T
    touching = (ids[a] == ids[b]) & (ids[a] > 0)
    rows, columns = [node_of[a[touching]]], [node_of[b[touching]]]
    steps = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]
    for x, y, z in steps:
        wanted = keys + (x * span[1] + y) * span[2] + z
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found = np.flatnonzero(keys[place] == wanted)
        rows.append(found)
        columns.append(place[found])
    row, column = np.concatenate(rows), np.concatenate(columns)
    result[known] = connected_groups((row, column), len(keys))[node_of[known]]
    return result
