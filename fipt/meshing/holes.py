"""Holes of a mesh: small ones closed, the others declared."""

from dataclasses import dataclass

import numpy as np

from fipt.groups import connected_groups
from fipt.meshing.topology import triangle_sides
from fipt.scene.mesh import Mesh

_AGAINST = -0.5
"""Mean cosine between a fan and the surface beside it below which they face opposite ways: the outline of a sheet."""


@dataclass(frozen=True)
class HoleFigures:
    """Holes found.

    Attributes
    ----------
    holes_closed
        Small holes, closed now.
    holes_open, hole_area
        Larger borders and outlines of loose sheets, which were left open, and the area in square metres that flat
        surface over them would have.
    """

    holes_closed: int
    holes_open: int
    hole_area: float


def without_small_holes(mesh: Mesh, across: float) -> tuple[Mesh, HoleFigures]:
    """Close the holes of up to ``across`` metres with a fan around their middle; vertices must be welded.

    The outline of a small loose sheet is no hole: a fan over it would be a second skin.
    """
    keys = triangle_sides(mesh.triangles).ravel()
    _, index, count = np.unique(keys, return_inverse=True, return_counts=True)
    alone = np.flatnonzero(count[index.reshape(-1)] == 1)
    if len(alone) == 0:
        return mesh, HoleFigures(0, 0, 0.0)
    triangle, slot = np.divmod(alone, 3)
    start, end = mesh.triangles[triangle, slot], mesh.triangles[triangle, (slot + 1) % 3]
    size = len(mesh.vertices)
    loop = connected_groups((start, end), size)[start]
    loops, loop = np.unique(loop, return_inverse=True)
    a, b = (mesh.vertices[ends].astype(np.float64) for ends in (start, end))
    length = np.linalg.norm(a - b, axis=1)
    around = np.bincount(loop, length)
    middle = np.stack([np.bincount(loop, length * c) for c in (0.5 * (a + b)).T], axis=1) / around[:, None]
    radius = np.zeros(len(loops))
    np.maximum.at(radius, loop, np.linalg.norm(a - middle[loop], axis=1))
    normal = 0.5 * np.cross(b - middle[loop], a - middle[loop])
    facing = np.bincount(loop, (normal * mesh.normals[triangle]).sum(axis=1))
    area = np.linalg.norm(np.stack([np.bincount(loop, c) for c in normal.T], axis=1), axis=1)
    # a border of less than three sides is the seam of a fold, not a hole
    small = (2 * radius <= across) & (np.bincount(loop) >= 3) & (facing > _AGAINST * area)
    number = size + np.cumsum(small) - 1
    filled = small[loop]
    fan = np.stack([end[filled], start[filled], number[loop[filled]]], axis=1)
    done = Mesh(
        np.concatenate([mesh.vertices, middle[small].astype(np.float32)]),
        np.concatenate([mesh.triangles, fan]).astype(np.int32),
    )
    figures = HoleFigures(int(small.sum()), int((~small).sum()), round(float(area[~small].sum()), 4))
    return done, figures
