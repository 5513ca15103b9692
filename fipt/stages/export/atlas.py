"""A texture atlas of a mesh: where its triangles lie in the textures, and which point of the surface a texel shows."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.scene.mesh import Mesh

_REACH = 1.0
"""Texels so far outside a triangle take their value from its edge: what bilinear lookups at the edge read."""
_CHUNK = 1 << 21
"""Texels that are compared with triangles at once."""
_SMALLEST, _TRIES = 16, 12


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
class Texels:
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
    """Lay a mesh out in the plane with xatlas.

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
        If the charts do not fit whatever the density.
    """
    members = [np.flatnonzero(groups == group) for group in np.unique(groups)]
    layout = _laid_out(mesh, members, density, padding)
    for _ in range(_TRIES):
        longest = max(layout.width, layout.height)
        if longest <= max_resolution and layout.atlas_count == 1:
            return _assembled(mesh, members, layout, density)
        density *= min(0.98 * max_resolution / longest, 0.9)
        layout = _laid_out(mesh, members, density, padding)
    raise FiptError(
        f"the mesh falls into {layout.chart_count} charts, too many for a texture of {max_resolution} texels",
        "raise export.max_resolution or lower export.padding",
    )


def _laid_out(mesh: Mesh, members: list[np.ndarray], density: float, padding: int) -> object:
    import xatlas

    atlas = xatlas.Atlas()
    for chosen in members:
        vertices, triangles = np.unique(mesh.triangles[chosen], return_inverse=True)
        atlas.add_mesh(mesh.vertices[vertices], triangles.reshape(-1, 3).astype(np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = density, padding, True
    atlas.generate(xatlas.ChartOptions(), options)
    return atlas


def _assembled(mesh: Mesh, members: list[np.ndarray], layout: object, density: float) -> Atlas:
    """One atlas of the groups' results, triangles in the mesh's order."""
    triangles = np.zeros_like(mesh.triangles)
    vertex, uv, first = [], [], 0
    for number, chosen in enumerate(members):
        source, corners, coordinates = layout.get_mesh(number)
        if len(corners) != len(chosen):
            raise RuntimeError(f"xatlas returned {len(corners)} triangles for {len(chosen)}")
        vertex.append(np.unique(mesh.triangles[chosen])[source])
        uv.append(coordinates)
        triangles[chosen] = corners.astype(np.int32) + first
        first += len(source)
    width, height = max(layout.width, _SMALLEST), max(layout.height, _SMALLEST)
    scale = np.array([layout.width / width, layout.height / height])
    placed = (np.concatenate(uv) * scale).astype(np.float32)
    return Atlas(np.concatenate(vertex).astype(np.int32), triangles, placed, width, height, layout.chart_count, density)


def texels(atlas: Atlas) -> Texels:
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
    return Texels(found, triangle[found], weights[found])


def _candidates(
    corners: np.ndarray, width: int, height: int, advance: object
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


def filled(values: np.ndarray, known: Texels, height: int, width: int) -> np.ndarray:
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
