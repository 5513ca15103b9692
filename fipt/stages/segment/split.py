"""Cells: the mesh with its large triangles cut, so that a segment may end inside a triangle.

The room's mesh never changes, since ids elsewhere refer to its triangles. Cells know the triangle they are cut from.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fipt.scene.mesh import Mesh

_COARSER = 1.1
"""Factor by which cells grow until there are few enough."""


@dataclass(frozen=True)
class Cells:
    """The cut mesh.

    Attributes
    ----------
    mesh
        C triangles, wound like those that they are cut from.
    parent
        (C,) int32 triangle of the room's mesh, ascending.
    size
        No side of a cell of a cut triangle is longer, metres; infinite where nothing is cut.
    """

    mesh: Mesh
    parent: np.ndarray
    size: float

    @cached_property
    def area(self) -> np.ndarray:
        """(C,) float64 square metres."""
        return self.mesh.areas

    def __len__(self) -> int:
        return len(self.parent)


def whole(mesh: Mesh) -> Cells:
    """The triangles themselves."""
    return Cells(mesh, np.arange(len(mesh.triangles), dtype=np.int32), np.inf)


def split(mesh: Mesh, chosen: np.ndarray, size: float, most: int) -> Cells:
    """Cut the ``chosen`` (T,) triangles until none of their sides is longer than ``size`` metres.

    Sides are halved, in both triangles that share one, so that no gap opens between neighbours and cells have the
    neighbours that triangles had; the others' cut sides make a few larger cells of them. The size grows where there
    would be more than about ``most`` cells; triangles are never joined.
    """
    sides, areas = _sides(mesh.corners[chosen]), mesh.areas[chosen]
    if len(sides) == 0 or size >= sides.max():
        return whole(mesh)
    others = len(mesh.triangles) - len(sides)
    while size < sides.max() and others + _estimate(sides, areas, size) > most:
        size *= _COARSER
    vertices, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    triangles = place.reshape(-1)[mesh.triangles].astype(np.int32)
    parent, fine = np.arange(len(triangles), dtype=np.int32), chosen.copy()
    while True:
        key = _keys(triangles)
        long = np.zeros(triangles.shape, bool)
        long[fine] = _sides(vertices[triangles[fine]]) > size
        cut = np.unique(key[long])
        if len(cut) == 0:
            break
        at = np.minimum(np.searchsorted(cut, key), len(cut) - 1)
        vertices, triangles, parent, fine = _cut(
            vertices, triangles, parent, fine, cut, np.where(cut[at] == key, at, -1)
        )
    order = np.argsort(parent, kind="stable")
    return Cells(Mesh(vertices, triangles[order]), parent[order], size)


def _keys(triangles: np.ndarray) -> np.ndarray:
    """(T, 3) int64 key of the side from corner k to k + 1, the same for both triangles at it."""
    following = np.roll(triangles, -1, axis=1).astype(np.int64)
    return np.minimum(triangles, following) << 32 | np.maximum(triangles, following)


def _sides(corners: np.ndarray) -> np.ndarray:
    """(T, 3) lengths of the sides from corner k to k + 1 of triangles (T, 3, 3)."""
    corners = corners.astype(np.float64)
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _estimate(sides: np.ndarray, areas: np.ndarray, size: float) -> float:
    """About how many cells there will be: by area where triangles are large, by length where they are slivers."""
    return float(np.maximum(1, np.maximum(4 * areas / size**2, 2 * sides.max(axis=1) / size - 1)).sum())


def _cut(
    vertices: np.ndarray, triangles: np.ndarray, parent: np.ndarray, fine: np.ndarray, key: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Halve sides: vertices, triangles, their parents and whether they are to be cut further.

    Parameters
    ----------
    key
        (K,) sides to halve.
    at
        (T, 3) which of these each side of each triangle is, -1 where it stays whole.
    """
    halves = 0.5 * (vertices[key >> 32].astype(np.float64) + vertices[key & 0xFFFFFFFF])
    middle = (len(vertices) + at).astype(np.int32)
    vertices = np.concatenate([vertices, halves.astype(np.float32)])
    long = at >= 0
    number = long.sum(axis=1)
    none = number == 0
    pieces: list[tuple[np.ndarray, ...]] = [(triangles[none], parent[none], fine[none])]

    def add(chosen: np.ndarray, *corners: tuple[np.ndarray, ...]) -> None:
        pieces.extend((np.stack(three, axis=1), parent[chosen], fine[chosen]) for three in corners)

    def turned(chosen: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, ...]:
        """Corners and middles of triangles, counted from side ``first`` of each."""
        turn = (first[:, None] + np.arange(3)) % 3
        return (*np.take_along_axis(triangles[chosen], turn, 1).T, *np.take_along_axis(middle[chosen], turn, 1).T)

    one = np.flatnonzero(number == 1)
    a, b, c, ab, _, _ = turned(one, long[one].argmax(axis=1))
    add(one, (a, ab, c), (ab, b, c))
    two = np.flatnonzero(number == 2)
    a, b, c, ab, bc, _ = turned(two, ((~long[two]).argmax(axis=1) + 1) % 3)  # the whole side is from c to a
    add(two, (ab, b, bc), (a, ab, bc), (a, bc, c))
    three = np.flatnonzero(number == 3)
    a, b, c, ab, bc, ca = turned(three, np.zeros(len(three), np.int64))
    add(three, (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    triangles, parent, fine = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    return vertices, triangles, parent, fine
