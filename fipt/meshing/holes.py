"""Holes of a mesh: small ones closed, and those that other surface hides from all views; the others declared."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fipt.meshing.topology import triangle_sides
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_INWARDS = (1 / 3, 2 / 3, 1.0)
"""Places where a view may look through a hole, from each side of its border to the middle."""
_HIDDEN = 0.95
"""Share of a hole that other surface must hide: rims show by the noise of the mesh."""


@dataclass(frozen=True)
class HoleFigures:
    """Holes found.

    Attributes
    ----------
    holes_closed
        Holes that are closed now: small ones, and hidden ones.
    holes_hidden
        Those of them that are larger than small, but hidden from all views.
    holes_open, hole_area
        Larger borders that were left open, and the area in square metres that flat surface over them would have.
    """

    holes_closed: int
    holes_hidden: int
    holes_open: int
    hole_area: float


@dataclass(frozen=True)
class _Holes:
    """Borders of holes: S sides, L loops.

    Attributes
    ----------
    start, end
        (S,) vertices of each side, in the order of its triangle.
    loop
        (S,) loop of each side.
    begin, finish
        (S, 3) float64 places of the vertices.
    length
        (S,) of sides, metres.
    """

    start: np.ndarray
    end: np.ndarray
    loop: np.ndarray
    begin: np.ndarray
    finish: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh) -> "_Holes":
        keys = triangle_sides(mesh.triangles).ravel()
        _, index, count = np.unique(keys, return_inverse=True, return_counts=True)
        triangle, slot = np.divmod(np.flatnonzero(count[index.reshape(-1)] == 1), 3)
        start, end = mesh.triangles[triangle, slot], mesh.triangles[triangle, (slot + 1) % 3]
        links = coo_matrix((np.ones(len(start), np.int8), (start, end)), shape=(len(mesh.vertices),) * 2)
        loop = np.unique(connected_components(links, directed=False)[1][start], return_inverse=True)[1].reshape(-1)
        begin, finish = (mesh.vertices[ends].astype(np.float64) for ends in (start, end))
        return cls(start, end, loop, begin, finish, np.linalg.norm(begin - finish, axis=1))

    def middles(self) -> np.ndarray:
        """(L, 3) middle of each loop."""
        around = np.bincount(self.loop, self.length)
        places = 0.5 * (self.begin + self.finish)
        return np.stack([np.bincount(self.loop, self.length * axis) for axis in places.T], axis=1) / around[:, None]


def without_hidden_holes(mesh: Mesh, across: float, cameras: Sequence[Camera]) -> tuple[Mesh, HoleFigures]:
    """Close holes with a fan around their middle: small ones, and those that other surface hides from all views.

    Parameters
    ----------
    mesh
        Its vertices must be welded.
    across
        Width up to which a hole is small, metres.
    cameras
        The views; Mitsuba's variant must be set.
    """
    holes = _Holes.of(mesh)
    if len(holes.start) == 0:
        return mesh, HoleFigures(0, 0, 0, 0.0)
    middle, loop = holes.middles(), holes.loop
    radius = np.zeros(len(middle))
    np.maximum.at(radius, loop, np.linalg.norm(holes.begin - middle[loop], axis=1))
    normal = 0.5 * np.cross(holes.finish - middle[loop], holes.begin - middle[loop])
    area = np.linalg.norm(np.stack([np.bincount(loop, axis) for axis in normal.T], axis=1), axis=1)
    # a border of less than three sides is the seam of a fold, not a hole
    hole = np.bincount(loop) >= 3
    small = hole & (2 * radius <= across)
    hidden = hole & ~small & _hidden(mesh, holes, middle, cameras, across)
    closed = small | hidden
    number = len(mesh.vertices) + np.cumsum(closed) - 1
    filled = closed[loop]
    fan = np.stack([holes.end[filled], holes.start[filled], number[loop[filled]]], axis=1)
    done = Mesh(
        np.concatenate([mesh.vertices, middle[closed].astype(np.float32)]),
        np.concatenate([mesh.triangles, fan]).astype(np.int32),
    )
    left = round(float(area[~closed].sum()), 4)
    return done, HoleFigures(int(closed.sum()), int(hidden.sum()), int((~closed).sum()), left)


def _hidden(mesh: Mesh, holes: _Holes, middle: np.ndarray, cameras: Sequence[Camera], tolerance: float) -> np.ndarray:
    """(L,) bool: the surface that would close a hole lies behind other surface wherever a view looks its way.

    No view looks through it, then. What no view looks towards may be half of the room.

    Parameters
    ----------
    middle
        (L, 3) middle of each hole.
    tolerance
        How far behind other surface it still counts as seen, metres.
    """
    scene, sides = RayScene(mesh), 0.5 * (holes.begin + holes.finish)
    seen, behind = np.zeros((2, len(_INWARDS), len(sides)), bool)
    for k, share in enumerate(_INWARDS):
        points = sides + share * (middle[holes.loop] - sides)
        for camera in cameras:
            image, depth = camera.project(points)
            inside = (depth > 0) & (image >= 0).all(axis=1) & (image < (camera.width, camera.height)).all(axis=1)
            at = np.flatnonzero(inside & ~seen[k])
            ray = points[at] - camera.center
            distance = np.linalg.norm(ray, axis=1)
            met, _ = scene.intersect(camera.center.astype(np.float32), (ray / distance[:, None]).astype(np.float32))
            seen[k, at] = met > distance - tolerance
            behind[k, at] = True
    hidden = (behind & ~seen).mean(axis=0)
    return np.bincount(holes.loop, holes.length * hidden) > _HIDDEN * np.bincount(holes.loop, holes.length)
