"""A texture atlas of a mesh: where its triangles lie in the textures, and which point of the surface a texel shows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fipt.child import run_in_child
from fipt.meshing.unwrap import lay_out
from fipt.progress import progress
from fipt.scene.mesh import Mesh

_REACH = 1.0
"""Texels so far outside a triangle take their value from its edge: what bilinear lookups at the edge read."""
_CHUNK = 1 << 21
"""Texels that are compared with triangles at once."""
_SMALLEST = 16
"""Least width and height of the textures, texels."""


@dataclass(frozen=True)
class Atlas:
    """Texture coordinates of a mesh.

    Attributes
    ----------
    vertex
        (V',) int32 vertex of the mesh that each vertex of the atlas is; those at seams occur several times.
    triangles
        (T, 3) int32 vertices of the atlas; triangles keep their order.
    uv
        (V', 2) float32 in [0, 1], the origin at the upper left corner.
    width, height
        Texels.
    charts
        Number of connected pieces.
    density
        Texels along a metre.
    """

    vertex: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    width: int
    height: int
    charts: int
    density: float

    def piece(self, mesh: Mesh, chosen: np.ndarray) -> tuple[Mesh, np.ndarray]:
        """Return some triangles (N,) as a mesh of their own, and its texture coordinates."""
        vertices, triangles = np.unique(self.triangles[chosen], return_inverse=True)
        part = Mesh(mesh.vertices[self.vertex[vertices]], triangles.reshape(-1, 3).astype(np.int32))
        return part, self.uv[vertices]


@dataclass(frozen=True)
class AtlasTexels:
    """Texels that show surface; N of them.

    Attributes
    ----------
    index
        (N,) int64 increasing, row-major number of the texel.
    triangle
        (N,) int32 that it shows.
    weights
        (N, 3) float32 barycentric coordinates of its centre, or of the point of the triangle next to it.
    """

    index: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray


def unwrap(mesh: Mesh, groups: np.ndarray, density: float, padding: int, max_resolution: int) -> Atlas:
    """Lay a mesh out in the plane with xatlas, in a process of its own (see `fipt.child`).

    Parameters
    ----------
    mesh
        T triangles.
    groups
        (T,) int32: triangles of different groups share no chart, so that their texels do not mix.
    density
        Texels along a metre; less where the atlas would become larger than ``max_resolution``.
    padding
        Texels between charts.
    max_resolution
        Longest side, texels.

    Raises
    ------
    FiptError
        If the charts do not fit whatever the density, or xatlas hangs or crashes in every attempt.
    """
    arguments = {
        "vertices": mesh.vertices,
        "triangles": mesh.triangles,
        "groups": groups,
        "density": density,
        "padding": padding,
        "max_resolution": max_resolution,
    }
    # On one CPU xatlas starts no threads; its crashes and hangs were seen with threads only.
    found = run_in_child(lay_out, arguments, time_limit(len(mesh.triangles)), cpus=1)
    charted = found["size"]
    width, height = (max(int(texels_of), _SMALLEST) for texels_of in charted)
    uv = (found["uv"] * (charted / [width, height])).astype(np.float32)
    charts, reached = int(found["charts"]), float(found["density"])
    return Atlas(found["vertex"], found["triangles"], uv, width, height, charts, reached)


def time_limit(triangles: int) -> float:
    """Seconds after which the unwrapping of a mesh counts as hanging.

    Its time grows with the square of the number of charts, at worst that of triangles: a noisy surface of 20,480
    triangles (4,053 charts) took 10 to 25 s on one CPU.
    """
    return 120.0 + 0.5 * (triangles / 1000) ** 2


def texels(atlas: Atlas) -> AtlasTexels:
    """Find the texels that show surface: centres inside a triangle, else those next to its edge."""
    corners = atlas.uv[atlas.triangles].astype(np.float64) * [atlas.width, atlas.height]
    count = atlas.width * atlas.height
    best = np.full(count, np.inf, np.float32)
    triangle = np.full(count, -1, np.int32)
    weights = np.zeros((count, 3), np.float32)
    with progress("atlas", len(corners), " triangles") as bar:
        for texel, owner in _candidates(corners, atlas.width, atlas.height, bar.advance):
            centre = np.stack([texel % atlas.width, texel // atlas.width], axis=1) + 0.5
            near, away = nearest_weights(corners[owner], centre)
            order = np.lexsort((owner, away, texel))
            kept = order[np.flatnonzero(np.diff(texel[order], prepend=-1))]
            kept = kept[(away[kept] <= _REACH) & (away[kept] < best[texel[kept]])]
            best[texel[kept]], triangle[texel[kept]], weights[texel[kept]] = away[kept], owner[kept], near[kept]
    found = np.flatnonzero(triangle >= 0)
    return AtlasTexels(found, triangle[found], weights[found])


def _candidates(
    corners: np.ndarray, width: int, height: int, advance: Callable[[int], None]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Texels around triangles and these triangles' numbers, a bounded number at once."""
    low = np.floor(corners.min(axis=1) - 0.5 - _REACH).astype(np.int64)
    high = np.ceil(corners.max(axis=1) - 0.5 + _REACH).astype(np.int64)
    low, high = np.maximum(low, 0), np.minimum(high, [width - 1, height - 1])
    size = high - low + 1
    # rows of texels: (triangle, row), each size[:, 0] long
    owner = np.repeat(np.arange(len(corners)), size[:, 1])
    row = np.arange(len(owner)) - np.repeat(np.cumsum(size[:, 1]) - size[:, 1], size[:, 1]) + low[owner, 1]
    ends = np.cumsum(size[owner, 0])
    start = 0
    while start < len(owner):
        before = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, before + _CHUNK)), start + 1)
        part = slice(start, stop)
        length = size[owner[part], 0]
        column = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        column += np.repeat(low[owner[part], 0], length)
        yield np.repeat(row[part], length) * width + column, np.repeat(owner[part], length).astype(np.int32)
        advance(int(owner[stop - 1] - (owner[start - 1] if start else -1)))
        start = stop


def nearest_weights(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates of the points of triangles next to given points, in the plane.

    Parameters
    ----------
    corners
        (N, 3, 2).
    points
        (N, 2).

    Returns
    -------
    weights
        (N, 3) float32 in [0, 1].
    distance
        (N,) float32 from the point; 0 inside.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    area = _cross(b - a, c - a)
    safe = np.where(np.abs(area) > 1e-12, area, 1.0)
    inner = np.stack([_cross(b - points, c - points), _cross(c - points, a - points)], axis=1) / safe[:, None]
    inner = np.concatenate([inner, 1 - inner.sum(axis=1, keepdims=True)], axis=1)
    inside = (inner >= 0).all(axis=1) & (np.abs(area) > 1e-12)
    weights = np.where(inside[:, None], inner, 0.0)
    distance = np.where(inside, 0.0, np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):  # the nearest point of the three edges
        start, edge = corners[:, first], corners[:, second] - corners[:, first]
        length = np.maximum((edge**2).sum(axis=1), 1e-24)
        along = np.clip(((points - start) * edge).sum(axis=1) / length, 0, 1)
        away = np.linalg.norm(start + along[:, None] * edge - points, axis=1)
        nearer = away < distance
        distance = np.where(nearer, away, distance)
        on_edge = np.zeros_like(weights)
        on_edge[:, first], on_edge[:, second] = 1 - along, along
        weights = np.where(nearer[:, None], on_edge, weights)
    return weights.astype(np.float32), distance.astype(np.float32)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def filled(values: np.ndarray, known: AtlasTexels, height: int, width: int) -> np.ndarray:
    """Textures (height, width, ...) of values (N, ...) at known texels; all others repeat the nearest known one.

    So mip maps and lookups past an edge never meet texels that nobody wrote.
    """
    from scipy.ndimage import distance_transform_edt

    empty = np.ones(height * width, bool)
    empty[known.index] = False
    nearest = distance_transform_edt(empty.reshape(height, width), return_distances=False, return_indices=True)
    number = np.zeros(height * width, np.int64)
    number[known.index] = np.arange(len(known.index))
    return values[number[nearest[0] * width + nearest[1]]]
