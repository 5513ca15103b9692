"""The unwrapping of a mesh by xatlas. It runs in a process of its own, so this module imports little."""

from typing import Any

import numpy as np

from fipt.errors import FiptError

_TRIES = 12
"""Densities tried until the atlas is small enough."""
_kept: list[Any] = []
"""Layouts stay until the process ends: xatlas sometimes hangs when it destroys one."""


def lay_out(
    vertices: np.ndarray,
    triangles: np.ndarray,
    groups: np.ndarray,
    density: float,
    padding: int,
    max_resolution: int,
) -> dict[str, np.ndarray]:
    """Lay a mesh out in the plane.

    Parameters
    ----------
    vertices, triangles
        (V, 3) float32 and (T, 3) int32 of the mesh.
    groups
        (T,) int32: triangles of different groups share no chart, so that their texels do not mix.
    density
        Texels along a metre; less where the atlas would become larger than ``max_resolution``.
    padding
        Texels between charts.
    max_resolution
        Longest side, texels.

    Returns
    -------
    dict
        ``vertex`` (V',) int32 vertex of the mesh that each vertex of the atlas is; ``triangles`` (T, 3) int32 in the
        mesh's order; ``uv`` (V', 2) float64 in [0, 1]; ``size`` (2,) width and height in texels; ``charts`` and
        ``density`` as they came out.

    Raises
    ------
    FiptError
        If the charts do not fit whatever the density.
    """
    members = [np.flatnonzero(groups == group) for group in np.unique(groups)]
    layout = _generated(vertices, triangles, members, density, padding)
    for _ in range(_TRIES):
        longest = max(layout.width, layout.height)
        if longest <= max_resolution and layout.atlas_count == 1:
            return _assembled(triangles, members, layout) | {"density": np.array(density)}
        density *= min(0.98 * max_resolution / longest, 0.9)
        layout = _generated(vertices, triangles, members, density, padding)
    raise FiptError(
        f"the mesh falls into {layout.chart_count} charts, too many for a texture of {max_resolution} texels",
        "raise export.max_resolution or lower export.padding",
    )


def _generated(
    vertices: np.ndarray, triangles: np.ndarray, members: list[np.ndarray], density: float, padding: int
) -> Any:
    """One layout of xatlas; each group is a mesh of it."""
    import xatlas

    atlas = xatlas.Atlas()
    for chosen in members:
        used, corners = np.unique(triangles[chosen], return_inverse=True)
        atlas.add_mesh(vertices[used], corners.reshape(-1, 3).astype(np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = float(density), int(padding), True
    atlas.generate(xatlas.ChartOptions(), options)
    _kept.append(atlas)
    return atlas


def _assembled(mesh_triangles: np.ndarray, members: list[np.ndarray], layout: Any) -> dict[str, np.ndarray]:
    """One atlas of the groups' results, triangles in the mesh's order."""
    triangles = np.zeros_like(mesh_triangles)
    vertex, uv, first = [], [], 0
    for number, chosen in enumerate(members):
        source, corners, coordinates = layout.get_mesh(number)
        if len(corners) != len(chosen):
            raise RuntimeError(f"xatlas returned {len(corners)} triangles for {len(chosen)}")
        vertex.append(np.unique(mesh_triangles[chosen])[source])
        uv.append(coordinates)
        triangles[chosen] = corners.astype(np.int32) + first
        first += len(source)
    return {
        "vertex": np.concatenate(vertex).astype(np.int32),
        "triangles": triangles,
        "uv": np.concatenate(uv),
        "size": np.array([layout.width, layout.height]),
        "charts": np.array(layout.chart_count),
    }
