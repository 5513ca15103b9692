"""What no mesh of a room should have, taken out with a count: unused vertices, triangles twice or without area."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.conventions import RAY_EPSILON
from fipt.errors import FiptError
from fipt.scene.mesh import Mesh

_ROUNDED = 0.1
"""Share of the rays' offset that rounding of coordinates may take."""
_LEAST_REACH = 1.0
"""Metres: how far the cameras of a room stand apart at least, in the sense of a scale."""


@dataclass(frozen=True)
class MendedMesh:
    """A mesh near the origin, and what was taken out of it.

    Attributes
    ----------
    mesh
        In the order of the source.
    figures
        Counts of what was taken out: ``unused_vertices``, ``doubled``, ``degenerate``.
    """

    mesh: Mesh
    figures: dict[str, Any]

    def warnings(self) -> list[str]:
        """A line that says what was taken out; none where nothing was."""
        names = {
            "doubled": "doubled triangles",
            "degenerate": "triangles without area",
            "unused_vertices": "unused vertices",
        }
        found = [f"{self.figures[key]} {name}" for key, name in names.items() if self.figures[key]]
        renumbered = self.figures["doubled"] or self.figures["degenerate"]
        shifted = "; numbers of triangles are those of what stays" if renumbered else ""
        return [f"taken out of the mesh: {', '.join(found)}{shifted}"] if found else []


def mended(vertices: np.ndarray, triangles: np.ndarray, origin: np.ndarray) -> MendedMesh:
    """Take out what is there twice or not at all, and move the mesh. One that has none of it keeps every bit.

    Triangles are equal if their corners are at the same places as float32, which is what is written, whatever their
    winding: rays meet either of them, and light would count twice. The first one stays. Emitters and ids that refer to
    triangles count what stays.

    Parameters
    ----------
    vertices
        (V, 3) float64 positions, metres.
    triangles
        (T, 3) int32.
    origin
        (3,) what is subtracted from positions, see `far_origin`.
    """
    written = (vertices - origin).astype(np.float32)
    corner = _places(written)[triangles]
    degenerate = (corner == np.roll(corner, 1, axis=1)).any(axis=1)
    degenerate |= ~_area_normals(written.astype(np.float64), triangles).any(axis=1)
    doubled = _repeated(np.sort(corner, axis=1)) & ~degenerate
    kept = triangles[~(doubled | degenerate)]
    if len(kept) == 0:
        raise FiptError("none of the mesh's triangles has an area", "repair the mesh, or check its unit")
    used = np.zeros(len(vertices), bool)
    used[kept] = True
    number = np.cumsum(used) - 1
    figures = {
        "unused_vertices": int((~used).sum()),
        "doubled": int(doubled.sum()),
        "degenerate": int(degenerate.sum()),
    }
    mesh = Mesh(written[used], number[kept].astype(np.int32))
    return MendedMesh(mesh, figures)


def far_origin(places: np.ndarray) -> np.ndarray:
    """(3,) float64 whole metres to subtract from the positions of a room; zeros where it is near the origin.

    Positions are float32 later: at a distance d from the origin they are rounded by d / 2^24. Coordinates of a map are
    moved, so that rounding stays below a tenth of the rays' offset.

    Parameters
    ----------
    places
        (N, 3) float64 of its cameras, or of its surface, metres.
    """
    middle = np.median(places, axis=0)
    reach = max(float(np.ptp(places, axis=0).max()), _LEAST_REACH)
    far = np.abs(middle).max() * 2.0**-24 > _ROUNDED * RAY_EPSILON * reach
    return np.rint(middle) if far else np.zeros(3)


def _area_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T, 3) float64 normals as long as twice the area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _places(vertices: np.ndarray) -> np.ndarray:
    """(V,) int64 number of the place of each vertex; equal positions have one number."""
    order = np.lexsort(vertices.T)
    number = np.empty(len(vertices), np.int64)
    number[order] = np.cumsum(_begins(vertices[order])) - 1
    return number


def _repeated(rows: np.ndarray) -> np.ndarray:
    """(N,) bool: an equal row comes before this one."""
    order = np.lexsort(rows.T)  # stable: the first of equal rows stays first
    repeated = np.empty(len(rows), bool)
    repeated[order] = ~_begins(rows[order])
    return repeated


def _begins(rows: np.ndarray) -> np.ndarray:
    """(N,) bool: a row differs from the one before it."""
    begins = np.ones(len(rows), bool)
    begins[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return begins
