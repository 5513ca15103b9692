"""Broken triangles, doubles and floaters taken out."""

from dataclasses import dataclass

import numpy as np

from fipt.meshing.topology import compact, distinct_rows, pieces
from fipt.scene.mesh import Mesh


@dataclass(frozen=True)
class CleanFigures:
    """What `clean` took out.

    Attributes
    ----------
    degenerate, duplicate
        Triangles without area, and those that another repeats.
    floaters, floater_triangles
        Small loose pieces, and their triangles.
    """

    degenerate: int
    duplicate: int
    floaters: int
    floater_triangles: int


def clean(mesh: Mesh, smallest: float, needed: np.ndarray | None = None) -> tuple[Mesh, CleanFigures]:
    """Weld vertices of one place; drop degenerate and duplicate triangles and floaters.

    Parameters
    ----------
    smallest
        Square metres; a piece below this area floats, unless views need it.
    needed
        (T,) bool: triangles that views need; None: none.
    """
    kept, vertex = distinct_rows(mesh.vertices)
    places, triangles = mesh.vertices[kept], vertex[mesh.triangles]
    sound = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])
    sound &= (triangles[:, 2] != triangles[:, 0]) & (mesh.areas > 0)
    first = np.zeros(len(triangles), bool)
    first[distinct_rows(np.sort(triangles, axis=1))[0]] = True
    keep = sound & first
    found = Mesh(places, triangles)
    piece = pieces(Mesh(places, triangles[keep]))
    count = int(piece.max(initial=-1)) + 1
    small = np.bincount(piece, found.areas[keep], count) < smallest
    if needed is not None:
        small &= np.bincount(piece, needed[keep], count) == 0
    floats = small[piece]
    if floats.all():
        floats[:] = False  # nothing but crumbs: then these are the room
    figures = CleanFigures(
        degenerate=int((~sound).sum()),
        duplicate=int((sound & ~first).sum()),
        floaters=len(np.unique(piece[floats])),
        floater_triangles=int(floats.sum()),
    )
    return compact(places, triangles[keep][~floats]), figures
