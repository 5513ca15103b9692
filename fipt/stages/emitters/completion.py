"""Surface that emits beside what views show to emit, though no pixel shows that it does.

- The rest of a connected part that glows wherever it is seen: the far side of a globe, the end of a thin strip that
  fills no pixel.
- Sides of a face that glows wherever it is seen, of triangles that views see from behind alone, and dark.
- What a scan tears from a lamp, or leaves attached to the ceiling: unseen surface which emitting surface surrounds on
  most of its border, if the emitter is closed by it. Bars between the panes of a window close nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.meshing.topology import side_list
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.expected import as_expected, known_light
from fipt.stages.emitters.settings import EmittersSettings
from fipt.stages.emitters.sides import LEAST_SEEN, faces, seen_sides

_WHOLE = 0.7
"""Share of the seen area of a part, or of a face, that must emit before the rest of it is taken to emit too."""
_LEAST_KNOWN = 0.15
"""Share of the area of a part that views must show: if it is less, as through a gap, nothing is said of the rest."""
_SURROUNDED = 0.5
"""Share of the border of unseen surface of which emitters must have more: a globe hangs on a cord."""
_CLOSED = 0.9
"""Share of an emitter's vector of area that may be left: of a closed surface they cancel; a cord may fill a hole."""
_OPEN = 0.02
"""Vector of area over area of an emitter from which it is open: below, rounding and noise decide."""
_WOUND = 0.98
"""Share of an emitter's edges along which the winding of triangles must agree: else its vectors of area say nothing."""
_SMOOTH = 0.5
"""Least cosine between normals of neighbours of one piece of unseen surface: a cord leaves a globe at a crease."""
_TOGETHER = 1e-4
"""Metres within which corners are one: preparation parts surface by less (`fipt.meshing.separate`)."""


@dataclass(frozen=True)
class Seen:
    """What views show of T triangles.

    Attributes
    ----------
    alone
        (T,) bool: pixels that they fill.
    dark
        (T, 2) bool: front and back that pixels show to be dark, if only pixels that other surface shares.
    radiance
        (T, 3) of pixels that they fill, NaN where there is none.
    """

    alone: np.ndarray
    dark: np.ndarray
    radiance: np.ndarray


def completed(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    found: Emitters,
    seen: Seen,
    settings: EmittersSettings,
    decided: Decided,
) -> Emitters:
    """The emitters with what emits beside them, and with the triangles of accepted ones that no pixel shows alone.

    Parameters
    ----------
    found
        What pixels show to emit.
    """
    part = connected_parts(mesh)
    observed = _observed(mesh, shards, found, seen, part)
    accepted = decided.emitter >= 0
    hidden = accepted & ~_emits(mesh, found)
    if settings.complete:
        behind = np.zeros(len(part), bool)
        if settings.sides == "seen":
            behind = _seen_from_behind(mesh, shards, found, seen.dark)
        hidden |= (behind | _far_sides(mesh, found, observed, behind)) & ~decided.rejected
    # an accepted emitter is a part of its own
    found = _with(mesh, found, hidden, np.where(accepted, int(part.max(initial=0)) + 1 + decided.emitter, part))
    if not settings.complete:
        return found
    owner = _closing(mesh, found, observed)
    chosen = (owner >= 0) & ~decided.rejected & ~np.isin(owner, found.emitter[accepted[found.triangle]])
    owner[found.triangle] = found.emitter
    return _with(mesh, found, chosen & ~accepted, owner)


def _observed(mesh: Mesh, shards: Sequence[ObservedShard], found: Emitters, seen: Seen, part: np.ndarray) -> np.ndarray:
    """(T,) bool: triangles that views show to emit or not.

    Beside a mirror a pixel of which a thin lamp has a share may be no brighter than a reflection. It does not show the
    lamp to be dark where it has the light that the lamp's ``part`` (T,) gives elsewhere.
    """
    dark = seen.dark.any(axis=1) & ~seen.alone
    asked = np.flatnonzero(dark & ~_emits(mesh, found) & np.isin(part, part[found.triangle]))
    if len(asked) == 0:
        return seen.alone | dark
    names, group = np.unique(part[asked], return_inverse=True)
    number = np.full(len(part), -1)
    number[asked] = group.reshape(-1)
    own = part[found.triangle]
    total, triangles = np.bincount(own, found.radiance.mean(axis=1)), np.bincount(own)
    level, light = total[names] / triangles[names], known_light(found, seen.radiance)
    dark[asked] = ~as_expected(shards, light, number, level).emits[number[asked]]
    return seen.alone | dark


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
    return found.joined(
        replace(
            found.chosen(nearest),
            triangle=hidden.astype(np.int32),
            area=mesh.areas[hidden].astype(np.float32),
            emitter=found.emitter[nearest],
        )
    )


def _far_sides(mesh: Mesh, found: Emitters, observed: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """(T,) bool: unseen triangles of a connected part that glows wherever it is seen, as a globe's far side.

    Of ``observed`` triangles (T,) those that views see from ``behind`` (T,) do not tell that it is dark.
    """
    part, areas, emits, visible = connected_parts(mesh), mesh.areas, _emits(mesh, found), observed & ~behind
    glowing, shown = np.bincount(part, areas * emits), np.bincount(part, areas * (visible | emits))
    known = np.bincount(part, areas * (observed | emits)) >= _LEAST_KNOWN * np.bincount(part, areas)
    whole = (glowing > 0) & (glowing >= _WHOLE * shown) & known
    return whole[part] & ~visible & ~emits


def _closing(mesh: Mesh, found: Emitters, visible: np.ndarray) -> np.ndarray:
    """(T,) int64 emitter that unseen surface closes, and that surrounds it; -1 for all other triangles."""
    owner = np.full(len(mesh.triangles), -1, np.int64)
    if len(found.triangle) == 0:
        return owner
    edges = _edges(mesh)
    emitter = owner.copy()
    emitter[found.triangle] = found.emitter
    unseen = ~visible & (emitter < 0)
    around, piece = _surrounding(mesh, edges, emitter, unseen)
    owner = np.where(unseen, around[piece], -1)
    count = int(found.emitter.max()) + 1

    def vectors(number: np.ndarray) -> np.ndarray:
        """(K, 3) sum of areas times normals of the triangles of each emitter."""
        own = number >= 0
        return np.stack([np.bincount(number[own], column, count) for column in mesh.area_normals[own].T], axis=1)

    before, after = (np.linalg.norm(each, axis=1) for each in (vectors(emitter), vectors(emitter) + vectors(owner)))
    inside = (emitter[edges.one] >= 0) & (emitter[edges.one] == emitter[edges.other])
    of_edge = emitter[edges.one[inside]]
    wound = np.bincount(of_edge, edges.agrees[inside], count) >= _WOUND * np.bincount(of_edge, minlength=count)
    opened = before > _OPEN * np.bincount(found.emitter, found.area, count)
    closed = wound & opened & (after < _CLOSED * before)
    return np.where((owner >= 0) & closed[owner], owner, -1)


def _surrounding(mesh: Mesh, edges: "_Edges", emitter: np.ndarray, unseen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) emitter that most of the border of each piece of ``unseen`` surface (T,) is of, and (T,) int64 piece.

    -1 where emitters are no more than half of the border, to which open edges belong. ``emitter`` (T,) is -1 where
    nothing emits.
    """
    one, other = edges.one, edges.other
    smooth = (mesh.normals[one] * mesh.normals[other]).sum(axis=1) > _SMOOTH
    joined = unseen[one] & unseen[other] & edges.agrees & smooth
    piece = connected_groups((one[joined], other[joined]), len(unseen))
    count, kinds = int(piece.max()) + 1, int(emitter.max()) + 2
    border = unseen[one] & (piece[one] != piece[other])
    of = np.where(edges.agrees, emitter[other], -1)
    ends = np.concatenate([piece[one[border]], piece[edges.open]])
    total = np.bincount(ends, np.concatenate([edges.length[border], edges.open_length]), count)
    # the length of border that each piece has with each emitter
    cell, index = np.unique(piece[one[border]] * kinds + of[border] + 1, return_inverse=True)
    length = np.bincount(index.reshape(-1), edges.length[border], len(cell))
    place, kind = cell // kinds, cell % kinds - 1
    emits = np.bincount(place, length * (kind >= 0), count)
    result = np.full(count, -1, np.int64)
    order = np.argsort(length, kind="stable")
    order = order[kind[order] >= 0]
    result[place[order]] = kind[order]  # the longest is written last
    return np.where(emits > _SURROUNDED * total, result, -1), piece


@dataclass(frozen=True)
class _Edges:
    """Edges of a mesh, of whose corners those `_TOGETHER` are one.

    Attributes
    ----------
    one, other
        (N,) int64 triangles that share an edge, both ways round; of an edge of more than two, those next in order.
    length
        (N,) of the edge, metres; above 0.
    agrees
        (N,) bool: both are wound alike.
    open, open_length
        (M,) triangles with an edge of their own, and its length.
    """

    one: np.ndarray
    other: np.ndarray
    length: np.ndarray
    agrees: np.ndarray
    open: np.ndarray
    open_length: np.ndarray


def _edges(mesh: Mesh) -> _Edges:
    """The edges of a mesh."""
    place, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    close = cKDTree(place).query_pairs(_TOGETHER, output_type="ndarray")
    corner = connected_groups(close.T, len(place))[vertex.reshape(-1)][mesh.triangles]
    ends, side = side_list(corner)
    _, first = np.unique(corner, return_index=True)
    known = np.zeros((int(corner.max(initial=-1)) + 1, 3))
    known[corner.ravel()[first]] = mesh.corners.reshape(-1, 3)[first]
    length = np.linalg.norm(known[ends[:, 0]] - known[ends[:, 1]], axis=1)
    forward, side = (corner < np.roll(corner, -1, axis=1)).ravel(), side.ravel()
    order = np.argsort(side, kind="stable")
    order = order[length[side[order]] > 0]  # an edge between corners that are one is none
    same = np.flatnonzero(side[order[1:]] == side[order[:-1]])
    a, b = order[same], order[same + 1]
    alone = order[np.bincount(side[order], minlength=len(ends))[side[order]] == 1]
    return _Edges(
        one=np.concatenate([a, b]) // 3,
        other=np.concatenate([b, a]) // 3,
        length=np.tile(length[side[a]], 2),
        agrees=np.tile(forward[a] != forward[b], 2),
        open=alone // 3,
        open_length=length[side[alone]],
    )


def _seen_from_behind(mesh: Mesh, shards: Sequence[ObservedShard], found: Emitters, dark: np.ndarray) -> np.ndarray:
    """(T,) bool: triangles of a glowing face of which views see the other side alone, and see it dark.

    Through the opening of a lampshade, or the end of a tube, a view sees the inside of what lights the wall behind. The
    face (`fipt.stages.emitters.sides`) glows wherever it is seen, and a few triangles of noise are no face. ``dark``
    (T, 2) are sides that are seen dark.
    """
    part, level, behind = connected_parts(mesh), np.zeros(len(mesh.triangles)), np.zeros(len(mesh.triangles), bool)
    emits = _emits(mesh, found)
    chosen = np.isin(part, part[emits])
    own = np.flatnonzero(chosen)
    if len(own) == 0:
        return behind
    level[found.triangle] = found.radiance.mean(axis=1)
    seen, bright = seen_sides(mesh, shards, chosen, level)
    seen |= dark
    face = faces(mesh, own, part[own])
    area, lit = seen[own] * mesh.areas[own, None], bright[own] & emits[own, None]
    glowing, visible = (np.bincount(face.ravel(), each.ravel()) for each in (area * lit, area))
    other = np.zeros(len(visible))
    other[face] = visible[face[:, ::-1]]
    whole = (visible > 0) & (glowing >= _WHOLE * visible) & (visible >= LEAST_SEEN * (visible + other))
    behind[own] = ~emits[own] & (whole[face] & ~seen[own] & seen[own, ::-1]).any(axis=1)
    return behind
