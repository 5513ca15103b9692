"""Mesh edges drawn over a photo: a wrong axis convention is seen at once.

The visible triangle of every pixel is found by rasterisation in NumPy, so that an import needs no
ray tracer. A camera-space direction d through a pixel (d_z = -1) meets the triangle with corners
m_0, m_1, m_2 where sum_i b_i m_i = d: inside the triangle all b_i = (M^-1 d)_i are >= 0, and their
sum is the inverse of the depth. So triangles that reach behind the camera need no clipping.
"""

from dataclasses import replace

import numpy as np

from fipt.formats.images import to_display
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_WIDTH = 960
"""Width of an overlay picture, pixels."""
_CREASE = np.cos(np.radians(25.0))
"""Neighbouring pixels whose normals differ by more than this angle show an edge."""
_STEP = 0.01
"""Distance from the neighbour's plane that shows an edge, as a fraction of the depth."""
_COLOR = np.array([255, 0, 200], np.uint8)
_BUDGET = 1 << 21
"""Pixel tests done at once: bounds memory."""


def overlay(mesh: Mesh, camera: Camera, radiance: np.ndarray) -> np.ndarray:
    """Draw the mesh's visible creases and outlines over a tone-mapped photo.

    Parameters
    ----------
    mesh, camera
        What to project, and how.
    radiance
        (H, W, 3) linear RGB of the camera's picture.

    Returns
    -------
    (h, w, 3) uint8 picture, 960 pixels wide.
    """
    from PIL import Image

    size = (_WIDTH, max(1, round(camera.height * _WIDTH / camera.width)))
    photo = np.asarray(Image.fromarray(to_display(radiance)).resize(size, Image.BICUBIC))
    triangle, depth = visible_triangles(mesh, resized(camera, *size))
    picture = photo.copy()
    picture[edges(mesh, resized(camera, *size), triangle, depth)] = _COLOR
    return picture


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same camera with pictures of another size."""
    x, y = width / camera.width, height / camera.height
    return replace(
        camera, width=width, height=height,
        fx=camera.fx * x, cx=camera.cx * x, fy=camera.fy * y, cy=camera.cy * y,
    )  # fmt: skip


def visible_triangles(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Find the triangle that the ray through each pixel's centre meets first.

    Returns
    -------
    triangle
        (H, W) int32, -1 where the ray misses the mesh.
    depth
        (H, W) float64 distance along the view axis in metres, infinite where it misses.
    """
    nearest = np.zeros(camera.height * camera.width)  # inverse depth
    owner = np.full(nearest.shape, -1, np.int32)
    rotation = camera.world_from_camera[:3, :3]
    for start in range(0, len(mesh.triangles), 1 << 18):
        block = mesh.corners[start : start + (1 << 18)].astype(np.float64)
        corners = (block - camera.center) @ rotation  # (T, 3, 3): corner, axis
        low, high = _bounds(corners, camera)
        volume = np.linalg.det(corners)  # zero for triangles seen edge-on
        usable = (high > low).all(axis=1) & (np.abs(volume) > 1e-15)
        index = np.flatnonzero(usable)
        inverse = np.linalg.inv(np.swapaxes(corners[index], 1, 2))
        low, extent = low[index], (high - low)[index]
        # Boxes of similar size are tested together, as one array.
        sizes = 1 << np.ceil(np.log2(extent)).astype(int)
        for width, height in np.unique(sizes, axis=0):
            members = np.flatnonzero((sizes == (width, height)).all(axis=1))
            step = max(1, _BUDGET // int(width * height))
            for first in range(0, len(members), step):
                part = members[first : first + step]
                pixel, depth, which = _cover(inverse[part], low[part], width, height, camera)
                _keep_nearest(nearest, owner, pixel, depth, start + index[part[which]])
    shape = (camera.height, camera.width)
    with np.errstate(divide="ignore"):
        return owner.reshape(shape), (1.0 / nearest).reshape(shape)


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


def _bounds(corners: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixel boxes of (T, 3, 3) camera-space triangles, cut at a plane just before the camera.

    Returns (T, 2) integer first and past-the-end column and row; empty boxes where nothing shows.
    """
    near = 1e-3
    start, end = corners, np.roll(corners, -1, axis=1)
    depth, depth_end = -start[..., 2], -end[..., 2]
    change = np.where(depth_end == depth, 1.0, depth_end - depth)
    cut = np.clip((near - depth) / change, 0.0, 1.0)[..., None]
    crossing = start + cut * (end - start)  # equals an end point where the edge does not cross
    points = np.concatenate([start, crossing], axis=1)
    ahead = -points[..., 2] >= near * 0.999
    z = np.where(ahead, -points[..., 2], 1.0)
    image = np.stack(
        [
            camera.cx + camera.fx * points[..., 0] / z,
            camera.cy - camera.fy * points[..., 1] / z,
        ],
        axis=-1,
    )
    size = np.array([camera.width, camera.height])
    low = np.where(ahead[..., None], image, np.inf).min(axis=1)
    high = np.where(ahead[..., None], image, -np.inf).max(axis=1)
    # Pixel j is covered at its centre j + 0.5; half a pixel more is allowed for rounding.
    low = np.clip(np.floor(low - 0.5), 0, size).astype(int)
    high = np.clip(np.ceil(high + 0.5), 0, size).astype(int)
    return low, high


def _cover(
    inverse: np.ndarray, low: np.ndarray, width: int, height: int, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Test every pixel of (T, 2) boxes; return pixel index, inverse depth, triangle of each hit."""
    columns = (low[:, 0, None] + np.arange(width))[:, None, :]
    rows = (low[:, 1, None] + np.arange(height))[:, :, None]
    x = (columns + 0.5 - camera.cx) / camera.fx
    y = (camera.cy - rows - 0.5) / camera.fy
    a = inverse[:, :, :, None, None]
    weights = [a[:, i, 0] * x + a[:, i, 1] * y - a[:, i, 2] for i in range(3)]
    total = weights[0] + weights[1] + weights[2]
    smallest = np.minimum(np.minimum(weights[0], weights[1]), weights[2])
    inside = (smallest >= -1e-9 * total) & (total > 0)
    inside &= (columns < camera.width) & (rows < camera.height)
    which, row, column = np.nonzero(inside)
    pixel = (low[which, 1] + row) * camera.width + low[which, 0] + column
    return pixel, total[inside], which


def _keep_nearest(
    nearest: np.ndarray, owner: np.ndarray, pixel: np.ndarray, depth: np.ndarray, index: np.ndarray
) -> None:
    """Enter samples (pixel, inverse depth, triangle) where they are nearer than what is there."""
    order = np.argsort(depth, kind="stable")  # of equal pixels, the last assignment stays
    pixel, depth, index = pixel[order], depth[order], index[order]
    wins = depth > nearest[pixel]
    nearest[pixel[wins]] = depth[wins]
    owner[pixel[wins]] = index[wins]
