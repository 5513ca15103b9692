"""Pieces of a mesh that are copies of each other, as a modeller sets up the chairs of a classroom.

The mesh of a scan or of photographs has hardly any: its pieces are not alike.
"""

from collections import defaultdict
from itertools import islice

import numpy as np

from fipt.scene.mesh import Mesh, connected_parts

_SAME_LENGTH = 0.01
_ROUNDING = 1e-4
"""By how much sides of copies may differ, as a share of their own length and of the longest: what files round."""
_COMPARED = 100
"""Shapes that a piece is compared with at most: crumbs of a scan are thousands, and none is a copy."""


def first_copies(mesh: Mesh, fewest: int = 4) -> np.ndarray:
    """(T,) int64 triangle that each is a copy of: the one at its place in one piece of that shape.

    Two connected pieces are of one shape where their triangles, as they are numbered, have the same sides: exporters
    write copies in one order. Mirrored ones count, however they are wound; those of another size do not. Pieces of less
    than ``fewest`` triangles have no shape that is told from others.
    """
    part = connected_parts(mesh)
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    sides = np.sort(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), axis=1)  # however they are wound
    order = np.argsort(part, kind="stable")
    pieces = np.split(order, np.cumsum(np.bincount(part))[:-1])
    first = np.arange(len(part), dtype=np.int64)
    # only shapes with about the same length of all sides are compared: a plant has thousands of leaves
    size = np.log(np.maximum([sides[piece].sum() for piece in pieces], 1e-30)) / _SAME_LENGTH
    shapes: dict[tuple[int, int], list[np.ndarray]] = defaultdict(list)
    for piece, about in zip(pieces, np.floor(size).astype(int), strict=True):
        if len(piece) < fewest:
            continue
        near = (shape for step in (-1, 0, 1) for shape in shapes.get((len(piece), about + step), ()))
        shape = next((shape for shape in islice(near, _COMPARED) if _is_copy(sides[piece], sides[shape])), None)
        if shape is None:
            shapes[len(piece), about].append(piece)
        else:
            first[piece] = shape
    return first


def _is_copy(sides: np.ndarray, others: np.ndarray) -> bool:
    """Whether triangles have the sides (K, 3) of others."""
    return bool((np.abs(sides - others) <= _SAME_LENGTH * others + _ROUNDING * others.max()).all())
