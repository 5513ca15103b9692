"""Triangles halved where they are too large, with no cracks between large and small ones."""

from collections.abc import Callable

import numpy as np

from fipt.meshing.topology import side_list
from fipt.scene.mesh import Mesh

_LEVELS = 40
"""Halvings at most: a million million triangles of one."""


def subdivided(mesh: Mesh, too_large: Callable[[Mesh], np.ndarray]) -> Mesh:
    """Halve triangles until none is too large.

    Parameters
    ----------
    too_large
        Mesh -> (T,) bool.
    """
    for _ in range(_LEVELS):
        wanted = too_large(mesh)
        if not wanted.any():
            break
        mesh = halved(mesh, wanted)
    return mesh


def halved(mesh: Mesh, wanted: np.ndarray) -> Mesh:
    """Halve these (T,) bool triangles at their longest sides, and others as far as their sides are halved so.

    Notes
    -----
    Longest-side bisection of Rivara (1984): angles never fall below half of the smallest one of the mesh.
    """
    ends, side = side_list(mesh.triangles)
    places = mesh.vertices.astype(np.float64)
    length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    rank = np.empty(len(ends), np.int64)
    rank[np.argsort(length, kind="stable")] = np.arange(len(ends))  # equal sides have an order too
    longest = rank[side].argmax(axis=1)
    first = side[np.arange(len(side)), longest]
    cut = np.zeros(len(ends), bool)
    cut[first[wanted]] = True
    while True:
        more = cut[side].any(axis=1) & ~cut[first]
        if not more.any():
            break
        cut[first[more]] = True
    middle = np.full(len(ends), -1, np.int64)
    middle[cut] = len(places) + np.arange(int(cut.sum()))
    vertices = np.concatenate([places, places[ends[cut]].mean(axis=1)]).astype(np.float32)
    return Mesh(vertices, _split(mesh.triangles, longest, middle[side]).astype(np.int32))


def _split(triangles: np.ndarray, longest: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Triangles after the cut; ``middle`` (T, 3) holds the new vertex of each side, -1 for none."""
    row = np.arange(len(triangles))[:, None]
    turn = (longest[:, None] + np.arange(3)) % 3
    (a, b, c), (m, q, r) = triangles[row, turn].astype(np.int64).T, middle[row, turn].T
    whole = m < 0
    left, right = ~whole & (r < 0), ~whole & (q < 0)  # halves that stay in one
    cut_left, cut_right = ~whole & (r >= 0), ~whole & (q >= 0)
    parts = [
        (whole, (a, b, c)),
        (left, (a, m, c)),
        (cut_left, (a, m, r)),
        (cut_left, (r, m, c)),
        (right, (m, b, c)),
        (cut_right, (m, b, q)),
        (cut_right, (m, q, c)),
    ]
    return np.concatenate([np.stack(corners, axis=1)[chosen] for chosen, corners in parts])


def split_sides(mesh: Mesh, ends: np.ndarray, side: np.ndarray, where: np.ndarray) -> Mesh:
    """Split sides at any place.

    Parameters
    ----------
    ends, side
        Edges of the mesh, from `fipt.meshing.topology.side_list`.
    where
        (E,) place between the first end (0) and the second (1); NaN: not split.
    """
    cut = np.isfinite(where)
    middle = np.full(len(ends), -1, np.int64)
    middle[cut] = len(mesh.vertices) + np.arange(int(cut.sum()))
    one, other = (mesh.vertices[column[cut]].astype(np.float64) for column in ends.T)
    new = one + where[cut, None] * (other - one)
    vertices = np.concatenate([mesh.vertices, new.astype(np.float32)])
    new_of = middle[side]
    count = (new_of >= 0).sum(axis=1)
    # turned so that a side that is not split comes last of two, and the only one that is split first
    first = np.where(count == 1, (new_of >= 0).argmax(axis=1), (((new_of < 0).argmax(axis=1)) + 1) % 3)
    turn = (first[:, None] + np.arange(3)) % 3
    row = np.arange(len(side))[:, None]
    (a, b, c), (m, q, r) = mesh.triangles[row, turn].astype(np.int64).T, new_of[row, turn].T
    parts = [
        (count == 0, (a, b, c)),
        (count == 1, (a, m, c)),
        (count == 1, (m, b, c)),
        (count == 2, (m, b, q)),
        (count == 2, (a, m, q)),
        (count == 2, (a, q, c)),
        (count == 3, (a, m, r)),
        (count == 3, (m, b, q)),
        (count == 3, (r, q, c)),
        (count == 3, (m, q, r)),
    ]
    triangles = np.concatenate([np.stack(corners, axis=1)[chosen] for chosen, corners in parts])
    return Mesh(vertices, triangles.astype(np.int32))
