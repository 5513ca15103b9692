"""Surface that emits beside what views show to emit, though no pixel shows that it does.

- The rest of a connected part that glows wherever it is seen: the far side of a globe.
- Sides of a face that glows wherever it is seen, of triangles that views see from behind alone, and dark.
- What a scan tears from a lamp, or leaves attached to the ceiling: unseen surface which emitting surface surrounds on
  most of its border, and which faces away from it. Bars between the panes of a window face the same way as these.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.meshing.topology import side_list
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.settings import EmittersSettings
from fipt.stages.emitters.sides import LEAST_SEEN, faces, seen_sides

_WHOLE = 0.7
"""Share of the seen area of a part, or of a face, that must emit before the rest of it is taken to emit too."""
_SURROUNDED = 0.5
"""Share of the border of unseen surface that must emit: a globe hangs on a cord."""
_SMOOTH = 0.5
"""Least cosine between normals of neighbours of one piece of unseen surface: a cord leaves a globe at a crease."""
_TOGETHER = 1e-4
"""Metres within which corners are one: preparation parts surface by less (`fipt.meshing.separate`)."""


def completed(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    found: Emitters,
    observed: np.ndarray,
    settings: EmittersSettings,
    decided: Decided,
) -> Emitters:
    """The emitters with what emits beside them, and with the triangles of accepted ones that no pixel shows alone.

    Parameters
    ----------
    found
        What pixels show to emit.
    observed
        (T,) bool: triangles that pixels show.
    """
    part = connected_parts(mesh)
    accepted = decided.emitter >= 0
    hidden = accepted & ~_emits(mesh, found)
    if settings.complete:
        hidden |= _far_sides(mesh, found, observed) & ~decided.rejected
        if settings.sides == "seen":
            hidden |= _seen_from_behind(mesh, shards, found) & ~decided.rejected
    # an accepted emitter is a part of its own
    found = _with(mesh, found, hidden, np.where(accepted, int(part.max(initial=0)) + 1 + decided.emitter, part))
    if not settings.complete:
        return found
    owner = _turned_away(mesh, found, observed)
    turned = (owner >= 0) & ~decided.rejected & ~accepted
    owner[found.triangle] = found.emitter
    return _with(mesh, found, turned, owner)


def _emits(mesh: Mesh, found: Emitters) -> np.ndarray:
    """(T,) bool: triangles that emit."""
    return np.isin(np.arange(len(mesh.triangles)), found.triangle)


def _with(mesh: Mesh, found: Emitters, hidden: np.ndarray, group: np.ndarray) -> Emitters:
    """Add the ``hidden`` triangles (T,) of each ``group`` (T,) that emits; each takes after the nearest one there."""
    hidden = np.flatnonzero(hidden & np.isin(group, group[found.triangle]))
    if len(hidden) == 0:
        return found
    far = 4 * float(np.ptp(mesh.vertices, axis=0).max() + 1)
    place = np.concatenate([mesh.corners.mean(axis=1), group[:, None] * far], axis=1)
    _, nearest = cKDTree(place[found.triangle]).query(place[hidden])
    triangle = np.concatenate([found.triangle, hidden.astype(np.int32)])
    order = np.argsort(triangle)
    rows = np.concatenate([np.arange(len(found.triangle)), nearest])[order]
    return Emitters(
        triangle=triangle[order],
        radiance=found.radiance[rows],
        area=mesh.areas[triangle[order]].astype(np.float32),
        emitter=found.emitter[rows],
        views=found.views[rows],
        confidence=found.confidence[rows],
        clipped=found.clipped[rows],
        lower_bound=found.lower_bound[rows],
        error=found.error[rows],
    )


def _far_sides(mesh: Mesh, found: Emitters, visible: np.ndarray) -> np.ndarray:
    """(T,) bool: unseen triangles of a connected part that glows wherever it is seen, as a globe's far side."""
    part, areas, emits = connected_parts(mesh), mesh.areas, _emits(mesh, found)
    glowing = np.bincount(part, areas * emits)
    whole = (glowing > 0) & (glowing >= _WHOLE * np.bincount(part, areas * (visible | emits)))
    return whole[part] & ~visible & ~emits


def _turned_away(mesh: Mesh, found: Emitters, visible: np.ndarray) -> np.ndarray:
    """(T,) int64 emitter that surrounds unseen surface, which faces away from it; -1 for all other triangles."""
    result = np.full(len(mesh.triangles), -1, np.int64)
    if len(found.triangle) == 0:
        return result
    one, other, length = _touching(mesh)
    unseen = ~visible & ~_emits(mesh, found)
    emitter = np.full(len(result), -1, np.int64)
    emitter[found.triangle] = found.emitter
    joined = unseen[one] & unseen[other] & ((mesh.normals[one] * mesh.normals[other]).sum(axis=1) > _SMOOTH)
    piece = connected_groups((one[joined], other[joined]), len(result))
    border = unseen[one] & (piece[one] != piece[other])
    count, kinds = int(piece.max()) + 1, int(found.emitter.max()) + 2
    # how much of the border of each piece is of which emitter; the first column is of none
    cell, index = np.unique(piece[one[border]] * kinds + emitter[other[border]] + 1, return_inverse=True)
    share = (
        np.bincount(index.reshape(-1), length[border])
        / np.bincount(piece[one[border]], length[border], count)[cell // kinds]
    )
    own = (cell % kinds > 0) & (share > _SURROUNDED)
    around = np.full(count, -1, np.int64)
    around[cell[own] // kinds] = cell[own] % kinds - 1
    area = mesh.area_normals
    facing = np.stack([np.bincount(found.emitter, column) for column in area[found.triangle].T], axis=1)
    of_piece = np.stack([np.bincount(piece, column * unseen, count) for column in area.T], axis=1)
    away = (of_piece * facing[around]).sum(axis=1) < 0
    return np.where(unseen & away[piece], around[piece], -1)


def _touching(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of triangles that share an edge, both ways round, (N,) each, and the length of the edge, metres.

    Corners `_TOGETHER` are one. Of an edge of more than two triangles, pairs are those next in order.
    """
    close = cKDTree(mesh.vertices).query_pairs(_TOGETHER, output_type="ndarray")
    corner = connected_groups(close.T, len(mesh.vertices))
    ends, side = side_list(corner[mesh.triangles])
    _, first = np.unique(corner, return_index=True)
    place = mesh.vertices[first].astype(np.float64)
    length = np.linalg.norm(place[ends[:, 0]] - place[ends[:, 1]], axis=1)
    flat = side.ravel()
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(flat[order[1:]] == flat[order[:-1]])
    one, other, of_edge = order[same] // 3, order[same + 1] // 3, length[flat[order[same]]]
    return np.concatenate([one, other]), np.concatenate([other, one]), np.concatenate([of_edge, of_edge])


def _seen_from_behind(mesh: Mesh, shards: Sequence[ObservedShard], found: Emitters) -> np.ndarray:
    """(T,) bool: triangles of a glowing face of which views see the other side alone, and see it dark.

    Through the opening of a lampshade a view sees the inside of what lights the wall behind. The face
    (`fipt.stages.emitters.sides`) glows wherever it is seen, and a few triangles of noise are no face.
    """
    part, level, behind = connected_parts(mesh), np.zeros(len(mesh.triangles)), np.zeros(len(mesh.triangles), bool)
    emits = _emits(mesh, found)
    chosen = np.isin(part, part[emits])
    own = np.flatnonzero(chosen)
    if len(own) == 0:
        return behind
    level[found.triangle] = found.radiance.mean(axis=1)
    seen, bright = seen_sides(mesh, shards, chosen, level)
    face = faces(mesh, own, part[own])
    area, lit = seen[own] * mesh.areas[own, None], bright[own] & emits[own, None]
    glowing, visible = (np.bincount(face.ravel(), each.ravel()) for each in (area * lit, area))
    other = np.zeros(len(visible))
    other[face] = visible[face[:, ::-1]]
    whole = (visible > 0) & (glowing >= _WHOLE * visible) & (visible >= LEAST_SEEN * (visible + other))
    behind[own] = ~emits[own] & (whole[face] & ~seen[own] & seen[own, ::-1]).any(axis=1)
    return behind
