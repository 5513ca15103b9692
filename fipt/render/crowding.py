"""Things that stand in one place: rays meet now one, now the other, and light of both counts."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from fipt.render.reach import points_on
from fipt.scene.mesh import Mesh

_GRID = 1e-5
"""Of the extent of all: corners nearer to each other are one."""
_THICK = 1e-3
"""Metres by which boxes are made larger: flat things have one too."""
_SHARED = 0.5
"""Share of the box around two things that both their boxes fill."""
_NEAR = 0.1
"""Of that box's diagonal: the median distance from one's surface to the other's."""
_POINTS = 512
_PRIMES = np.array([73_856_093, 19_349_663, 83_492_791], np.uint64)
"""Which make one number of three."""


def crowded(things: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> list[tuple[str, str]]:
    """Pairs of things that fill nearly the same place, whatever their triangles are.

    Parameters
    ----------
    things
        Name -> vertices (V, 3) metres and triangles (T, 3).
    """
    from scipy.spatial import cKDTree

    boxes = {name: _box(vertices[np.unique(triangles)]) for name, (vertices, triangles) in things.items()}
    found = []
    for one, other in combinations(things, 2):
        (low, high), (others_low, others_high) = boxes[one], boxes[other]
        inner = np.maximum(np.minimum(high, others_high) - np.maximum(low, others_low), 0)
        outer = np.maximum(high, others_high) - np.minimum(low, others_low)
        if np.prod(inner) < _SHARED * np.prod(outer):
            continue
        away, _ = cKDTree(points_on(*things[one], _POINTS)).query(points_on(*things[other], _POINTS))
        if np.median(away) < _NEAR * np.linalg.norm(outer):
            found.append((one, other))
    return found


def _box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points.min(axis=0) - _THICK, points.max(axis=0) + _THICK


def doubled_parts(mesh: Mesh, part: np.ndarray, names: tuple[str, ...]) -> list[tuple[str, str, int]]:
    """Pairs of parts that have triangles in the same place, in any winding, and how many.

    Parameters
    ----------
    part
        (T,) ids, from 1.
    names
        Of the parts.
    """
    corners = mesh.corners.astype(np.float64)
    step = _GRID * max(float(np.ptp(corners.reshape(-1, 3), axis=0).max()), 1e-30)
    grid = np.round(corners / step).astype(np.int64).astype(np.uint64)
    place = ((grid @ _PRIMES) ** np.uint64(3)).sum(axis=1)  # equal for equal corners in any order, modulo 2^64
    order = np.lexsort((part, place))
    again = np.flatnonzero(np.diff(place[order]) == 0)
    pairs = np.sort(np.stack([part[order[again]], part[order[again + 1]]], axis=1).astype(np.int64), axis=1)
    pairs, count = np.unique(pairs[pairs[:, 0] != pairs[:, 1]].reshape(-1, 2), axis=0, return_counts=True)
    return [(names[a - 1], names[b - 1], int(n)) for (a, b), n in zip(pairs, count, strict=True)]
