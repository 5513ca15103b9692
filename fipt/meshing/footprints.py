"""How finely the views resolve a surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_RAYS = 400_000
"""Rays that are traced at most: a footprint needs no pixel's exactness."""
_POINTS = 50_000
"""Points that stand for the seen surface; a hundred square metres then have one every 5 cm."""


@dataclass(frozen=True)
class SeenSurface:
    """Places that pixels of the views see.

    Attributes
    ----------
    position
        (N, 3) float32, metres.
    footprint
        (N,) float32 side of the pixel at its surface, across the ray, metres.
    triangle
        (N,) int32 the triangle that is seen.
    """

    position: np.ndarray
    footprint: np.ndarray
    triangle: np.ndarray

    def footprint_at(self, points: np.ndarray) -> np.ndarray:
        """(M,) footprint at the seen place nearest to each of (M, 3) points."""
        step = max(1, len(self.position) // _POINTS)
        places, sizes = self.position[::step], self.footprint[::step]
        return sizes[cKDTree(places).query(points, workers=-1)[1]]


def seen_surface(mesh: Mesh, cameras: Sequence[Camera]) -> SeenSurface:
    """Trace rays through pixel centres of the cameras, every pixel or evenly some; Mitsuba's variant must be set."""
    if not cameras:
        return SeenSurface(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int32))
    scene = RayScene(mesh)
    pixels = sum(camera.width * camera.height for camera in cameras)
    step = max(1, int(np.ceil(np.sqrt(pixels / _RAYS))))
    positions, footprints, triangles = [], [], []
    for camera in cameras:
        rows, columns = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step] + 0.5
        directions = camera.directions(columns, rows).reshape(-1, 3)
        distance, triangle = scene.intersect(camera.center, directions)
        met = triangle >= 0
        distance, triangle = distance[met], triangle[met]
        positions.append((camera.center + distance[:, None] * directions[met]).astype(np.float32))
        footprints.append((distance / max(camera.fx, camera.fy)).astype(np.float32))
        triangles.append(triangle)
    return SeenSurface(np.concatenate(positions), np.concatenate(footprints), np.concatenate(triangles))
