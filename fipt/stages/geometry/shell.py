"""A shell around the room: light that finds a hole in what was fused ends there."""

import numpy as np
from scipy.spatial import cKDTree

from fipt.scene.mesh import Mesh, surface_points
from fipt.stages.geometry.room_box import RoomBox

_BEHIND = 2
"""Voxels between the box and its shell: noise does not push what was fused through it."""
_CELL = 10
"""Voxels along a side of its squares."""
_GRAZING = 3.0
"""Tangent of the angle of incidence up to which light through an opening passes the shell behind it (72 degrees)."""
_FACING = 0.7
"""Cosine between a pane and the side of the shell that lies behind it, at least."""
_DEEP = 0.3
"""Metres behind a pane, at most, of a shell that hides the outside from it."""


def with_shell(mesh: Mesh, box: RoomBox, voxel: float) -> Mesh:
    """Return the mesh with the faces of the room's box behind it, which face inwards."""
    low, high = box.low - _BEHIND * voxel, box.high + _BEHIND * voxel
    vertices, triangles, count = [mesh.vertices], [mesh.triangles], len(mesh.vertices)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        steps = [max(int(np.ceil((high[i] - low[i]) / (_CELL * voxel))), 1) for i in (u, v)]
        for end, inward in ((low[axis], True), (high[axis], False)):
            grid = np.zeros((steps[0] + 1, steps[1] + 1, 3))
            grid[..., axis] = end
            grid[..., u] = np.linspace(low[u], high[u], steps[0] + 1)[:, None]
            grid[..., v] = np.linspace(low[v], high[v], steps[1] + 1)[None, :]
            number = count + np.arange(grid[..., 0].size).reshape(grid.shape[:2])
            a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
            squares = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
            vertices.append(grid.reshape(-1, 3) @ box.directions)
            triangles.append(squares if inward else squares[:, ::-1])
            count += grid[..., 0].size
    return Mesh(np.concatenate(vertices).astype(np.float32), np.concatenate(triangles).astype(np.int32))


def shell_behind(mesh: Mesh, first: int, open_: np.ndarray, voxel: float) -> np.ndarray:
    """Tell which triangles of the shell light through openings passes.

    Parameters
    ----------
    first
        Number of the shell's first triangle; it has all that follow.
    open_
        (T,) bool: triangles that close openings.

    Returns
    -------
    behind
        (T,) bool.
    """
    behind = np.zeros(len(open_), bool)
    panes = Mesh(mesh.vertices, mesh.triangles[:first][open_[:first]])
    if len(panes.triangles):
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        points, pane = surface_points(panes, _CELL * voxel / 2, low, high, seed=0)
        middle, normal = mesh.corners[first:].mean(axis=1), mesh.normals[first:]
        _, nearest = cKDTree(points).query(middle)
        way = points[nearest] - middle
        before = (way * normal).sum(axis=1)  # the shell faces inwards
        aside = np.sqrt(np.maximum((way**2).sum(axis=1) - before**2, 0))
        along = np.abs((panes.normals[pane[nearest]] * normal).sum(axis=1)) > _FACING
        near = (before > 0) & (before < _DEEP)
        behind[first:] = along & near & (aside < _GRAZING * before + _CELL * voxel)
    return behind
