"""Mesh edges drawn over a photo: a wrong axis convention is seen at once."""

import numpy as np

from fipt.formats.images import to_display
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_WIDTH = 960
"""Width of an overlay, pixels."""
_CREASE = np.cos(np.radians(25.0))
"""Neighbouring pixels whose normals differ by more than this angle show an edge."""
_STEP = 0.01
"""Distance from the neighbour's plane that shows an edge, as a fraction of the depth."""
_COLOR = np.array([255, 0, 200], np.uint8)


def overlay(mesh: Mesh, camera: Camera, radiance: np.ndarray) -> np.ndarray:
    """Draw the mesh's visible creases and outlines over a tone-mapped photo; Mitsuba's variant must be set.

    Parameters
    ----------
    mesh, camera
        What to project, and how.
    radiance
        (H, W, 3) linear RGB of the camera's image.

    Returns
    -------
    (h, w, 3) uint8 sRGB, 960 pixels wide.
    """
    from PIL import Image

    size = (_WIDTH, max(1, round(camera.height * _WIDTH / camera.width)))
    photo = np.asarray(Image.fromarray(to_display(radiance)).resize(size, Image.Resampling.BICUBIC))
    small = camera.resized(*size)
    triangle, depth = visible_triangles(RayScene(mesh), small)
    image = photo.copy()
    image[edges(mesh, small, triangle, depth)] = _COLOR
    return image


def visible_triangles(scene: RayScene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Find the triangle that the ray through each pixel's centre meets first.

    Returns
    -------
    triangle
        (H, W) int32, -1 where the ray misses the mesh.
    depth
        (H, W) float64 distance along the view axis in metres, infinite where it misses.
    """
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns, rows).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center, directions)
    depth = distance * -(directions.astype(np.float64) @ camera.world_from_camera[:3, 2])
    return triangle.reshape(rows.shape), depth.reshape(rows.shape)


def edges(mesh: Mesh, camera: Camera, triangle: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels beside a crease, an outline or the mesh's end.

    Parameters
    ----------
    triangle, depth
        As `visible_triangles` returns them.
    """
    hit = triangle >= 0
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = np.stack([(columns - camera.cx) / camera.fx, (camera.cy - rows) / camera.fy, -np.ones_like(rows)], -1)
    points = directions * np.where(hit, depth, 0.0)[..., None]
    normals = (mesh.normals @ camera.world_from_camera[:3, :3])[triangle]
    marked = np.zeros(triangle.shape, bool)
    full, before, after = slice(None), slice(None, -1), slice(1, None)
    for here, there in (((full, before), (full, after)), ((before, full), (after, full))):
        cosine = np.abs((normals[here] * normals[there]).sum(-1))
        step = np.abs((normals[here] * (points[there] - points[here])).sum(-1))
        nearer = np.minimum(depth[here], depth[there])
        both = hit[here] & hit[there]
        bent = both & ((cosine < _CREASE) | (step > _STEP * np.where(both, nearer, 0.0)))
        marked[here] |= bent | (hit[here] != hit[there])
    return marked
