"""Sheets get a back of their own, where light can come from behind them though no view shows that.

A scan of a lampshade is a sheet without thickness: views show its outside, and light leaves through its openings from
an inside that no view shows. The inside becomes surface of its own, so that something there may emit (ADR 89).
"""

from collections.abc import Sequence

import numpy as np

from fipt.meshing.footprints import SeenSurface, seen_surface
from fipt.meshing.topology import compact, pieces
from fipt.render.directions import cosine_directions
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_RAYS = 2_000_000
"""Rays from what views see: some hundreds then go through the opening of a lampshade."""
_RINGS = 2
"""Rings of triangles around those that rays meet from behind, which belong to the back: rays leave gaps."""
_SMALLEST = 4.0
"""Area in footprints of the smallest back: what is smaller is noise of the surface."""
_SHOWN = 0.05
"""Share of the pixels of a sheet that may show its back: noise of scans turns 1 to 2 % of the triangles."""


def with_backs(mesh: Mesh, cameras: Sequence[Camera], gap: float) -> tuple[Mesh, int]:
    """Add the backs that light can come from; return the mesh, and how many connected backs it got.

    The triangles of the mesh stay as they are, and come first. A back is wound to face away from its sheet.

    Parameters
    ----------
    cameras
        The training views.
    gap
        Metres between a sheet and its back.
    """
    seen = seen_surface(mesh, cameras)
    fronts, backs = np.zeros((2, len(mesh.triangles)), np.int64)
    np.add.at(fronts, seen.triangle[seen.front], 1)
    np.add.at(backs, seen.triangle[~seen.front], 1)
    piece = pieces(mesh)
    turned = np.bincount(piece, backs) > np.bincount(piece, fronts)  # wound away from the views
    outside = np.where(turned[piece], -1, 1)
    behind = _met_from_behind(mesh, seen, outside)
    around = np.zeros(len(mesh.vertices), bool)
    for _ in range(_RINGS):
        around[mesh.triangles[behind]] = True
        behind |= around[mesh.triangles].any(axis=1)
    triangles = np.flatnonzero(behind)
    group = pieces(Mesh(mesh.vertices, mesh.triangles[triangles]))
    inside, all_ = np.where(turned[piece], fronts, backs)[triangles], (fronts + backs)[triangles]
    shown = np.bincount(group, inside) > _SHOWN * np.maximum(np.bincount(group, all_), 1)
    large = np.bincount(group, mesh.areas[triangles]) >= _SMALLEST * float(np.median(seen.footprint)) ** 2
    kept = (large & ~shown)[group]
    back = _moved(mesh, triangles[kept], -outside[triangles[kept]], gap)
    vertices, first = np.concatenate([mesh.vertices, back.vertices]), len(mesh.vertices)
    return Mesh(vertices, np.concatenate([mesh.triangles, back.triangles + first])), len(np.unique(group[kept]))


def _met_from_behind(mesh: Mesh, seen: SeenSurface, outside: np.ndarray) -> np.ndarray:
    """(T,) bool: triangles that rays from what is seen meet from behind; ``outside`` (T,) is 1, or -1 if turned."""
    scene, rng = RayScene(mesh), np.random.default_rng(0)
    result = np.zeros(len(mesh.triangles), bool)
    normal = scene.normals[seen.triangle] * np.where(seen.front, 1, -1)[:, None].astype(np.float32)
    for _ in range(max(1, _RAYS // max(len(normal), 1))):
        direction = cosine_directions(normal, rng)
        _, triangle = scene.intersect(seen.position + scene.epsilon * normal, direction)
        met = triangle[triangle >= 0]
        along = (direction[triangle >= 0] * scene.normals[met]).sum(axis=1) * outside[met]
        result[met[along > 0]] = True
    return result


def _moved(mesh: Mesh, triangles: np.ndarray, side: np.ndarray, gap: float) -> Mesh:
    """The ``triangles`` (N,) alone, moved by ``gap`` to a ``side`` (N,), 1 or -1 along normals, and wound to face there."""
    corners = mesh.triangles[triangles]
    along = np.zeros(mesh.vertices.shape)
    for corner in corners.T:
        np.add.at(along, corner, side[:, None] * mesh.area_normals[triangles])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    wound = np.where(side[:, None] < 0, corners[:, ::-1], corners)
    return compact(mesh.vertices + gap * along, wound)
