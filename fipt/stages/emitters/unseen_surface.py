"""Unseen surface: which triangles no view shows, gathered to patches that may emit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.scene.voxels import facings

_PATCH_ROWS = 12
"""Patches along the box in the first guess, at most; `patches_of` makes them larger where there would be too many."""
_MOST_PATCHES = 200
_MOST_PARTS = 64
"""Small parts that are candidates: a plant may have thousands of leaves."""
_SAME_AREA = 2
"""Decimals of the logarithm of the area by which copies of a part are told: within 1 %."""
_LEVELS = 128
"""Steps along the box by which planes that face the same way are told apart: a pane from the ceiling around it."""


@dataclass(frozen=True)
class Patches:
    """P pieces of unseen surface.

    Attributes
    ----------
    number
        (T,) int64 patch of each triangle, -1 for triangles that are seen.
    center
        (P, 3) metres.
    area
        (P,) square metres.
    piece
        (P,) int64 number of the connected plane, or of the small part, that each belongs to; -1 where a plane is small,
        or lights nothing that is seen.
    side
        Of the cells of the grid, metres.
    kept
        (P,) bool: of a guess of the round before. Where there are such patches, no other is a candidate.
    part
        (T,) int64 number of the small part that each triangle belongs to (`small_parts`), -1 elsewhere.
    """

    number: np.ndarray
    center: np.ndarray
    area: np.ndarray
    piece: np.ndarray
    side: float
    kept: np.ndarray
    part: np.ndarray

    def finer(self, chosen: np.ndarray, mesh: Mesh) -> "Patches":
        """The same surface, in cells of half the side within a cell of the ``chosen`` patches (P,) bool."""
        around = self._around(chosen, mesh)
        small = patches_of(mesh, around, self.part, 0.5 * self.side)
        number = np.where(around, small.number, np.where(self.number >= 0, self.number + len(small.area), -1))
        pieces = np.where(self.piece >= 0, self.piece + small.piece.max(initial=-1) + 1, -1)
        return _gathered(mesh, number, np.concatenate([small.piece, pieces]), small.side, self.part)

    def only(self, chosen: np.ndarray, mesh: Mesh) -> "Patches":
        """The ``chosen`` patches (P,) bool alone, in their order."""
        number = np.where(np.append(chosen, False)[self.number], self.number, -1)  # triangles of no patch have -1
        return _gathered(mesh, number, self.piece, self.side, self.part)

    def _around(self, chosen: np.ndarray, mesh: Mesh) -> np.ndarray:
        """(T,) bool: triangles whose centres are no farther than a cell from those of the chosen patches.

        All of a small part, if one of its triangles is.
        """
        centers, own = mesh.corners.mean(axis=1), np.flatnonzero(self.number >= 0)
        near = own[chosen[self.number[own]]]
        result = np.zeros(len(self.number), bool)
        if len(near):
            away, _ = cKDTree(centers[near]).query(centers[own], distance_upper_bound=self.side, workers=-1)
            result[own] = np.isfinite(away)
        return result | (self.number >= 0) & (self.part >= 0) & np.isin(self.part, self.part[result])

    @property
    def candidates(self) -> np.ndarray:
        """(P, Q) float64, 1 where a candidate has a patch: every patch, piece of several patches, all copies of a part.

        A pane or a bulb shines as a whole, and spots of one kind shine alike. Each guess of the round before is one
        candidate.
        """
        if self.kept.any():
            offered = self.kept & (self.piece >= 0)  # what is enclosed is of no piece
            return (self.piece[:, None] == np.unique(self.piece[offered])).astype(np.float64)
        pieces, count = np.unique(self.piece[self.piece >= 0], return_counts=True)
        whole = self.piece[:, None] == pieces[count > 1]
        return np.concatenate([np.eye(len(self.area)), whole, self._copies()], axis=1)

    def _copies(self) -> np.ndarray:
        """(P, K) bool: the patches of all small parts of one shape, by triangles and area, that light what is seen."""
        small = np.flatnonzero(self.of_small_parts & (self.piece >= 0))
        piece, owner = np.unique(self.piece[small], return_inverse=True)
        triangles = np.bincount(self.number[self.number >= 0], minlength=len(self.area))[small]
        area = np.log(np.bincount(owner, self.area[small], len(piece)))
        shape = np.column_stack([np.bincount(owner, triangles, len(piece)), np.round(area, _SAME_AREA)])
        _, kind, count = np.unique(shape, axis=0, return_inverse=True, return_counts=True)
        result = np.zeros((len(self.area), len(count)), bool)
        result[small, kind.reshape(-1)[owner]] = True
        return result[:, count > 1]

    @property
    def of_small_parts(self) -> np.ndarray:
        """(P,) bool: patches of small parts."""
        result = np.zeros(len(self.area), bool)
        result[self.number[(self.part >= 0) & (self.number >= 0)]] = True
        return result

    def small(self, chosen: np.ndarray) -> np.ndarray:
        """Numbers of the small parts all of which is of the ``chosen`` patches (P,) bool."""
        own = (self.part >= 0) & (self.number >= 0)
        return np.setdiff1d(self.part[own], self.part[own & ~chosen[self.number]])

    def columns_of(self, parts: np.ndarray) -> tuple[int, ...]:
        """Columns of `candidates` that are small parts of these numbers."""
        candidates, columns = self.candidates > 0, []
        for part in parts:
            own = np.isin(np.arange(len(self.area)), self.number[(self.part == part) & (self.number >= 0)])
            columns += np.flatnonzero((candidates == own[:, None]).all(axis=0))[:1].tolist()
        return tuple(columns)

    def lighting(self, arrives: np.ndarray, least: float) -> np.ndarray:
        """(P,) bool: patches of whose light a share of more than ``least`` arrives. A small part is judged as a whole.

        ``arrives`` (P,) is the share times the area, square metres.
        """
        return self._of_whole(arrives) / np.maximum(self._of_whole(self.area), 1e-12) > least

    def at_least(self, area: float) -> np.ndarray:
        """(P,) bool: patches of this area or more, square metres. A small part is judged as a whole."""
        return self._of_whole(self.area) >= area

    def share_of(self, rays: np.ndarray, met: np.ndarray) -> np.ndarray:
        """(P,) share of ``rays`` (T,) among all that ``met`` (T,) the triangles of a patch; 1 where none did."""
        own = self.number >= 0
        chosen, every = (np.bincount(self.number[own], each[own], len(self.area)) for each in (rays, met))
        return np.where(every > 0, chosen / np.maximum(every, 1), 1.0)

    def _of_whole(self, values: np.ndarray) -> np.ndarray:
        """(P,) sums of values (P,) over the small part that a patch is of; of others the patch's own."""
        owner, own = np.arange(len(self.area)), (self.part >= 0) & (self.number >= 0)
        owner[self.number[own]] = len(owner) + self.part[own]
        _, owner = np.unique(owner, return_inverse=True)
        return np.bincount(owner, values)[owner]


def hidden_triangles(mesh: Mesh, shards: Sequence[ObservedShard], found: Emitters) -> np.ndarray:
    """(T,) bool: triangles that no pixel shows, and that lie farther from what is seen than two pixels are wide.

    Masked pixels show nothing. They are black; those beside an opening have no weight either, but do show surface.
    Seen surface counts that faces the same way: the underside of a cupboard is hidden, close as its front may be.
    """
    seen = np.zeros(len(mesh.triangles), bool)
    seen[found.triangle] = True
    positions, normals = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.float32)]
    for shard in shards:
        shows = (np.asarray(shard.weight) > 0) | (np.asarray(shard.radiance) > 0).any(axis=1)
        inner = (np.asarray(shard.samples.weight) >= ALONE) & np.repeat(shows, np.diff(shard.samples.offsets))
        seen[np.asarray(shard.samples.triangle)[inner]] = True
        positions.append(np.asarray(shard.samples.position)[inner])
        normals.append(np.asarray(shard.samples.normal)[inner])
    points, hidden = np.concatenate(positions), ~seen & (mesh.areas > 0)
    widths = np.concatenate([np.zeros(1, np.float32), *(shard.samples.footprint for shard in shards)])[1:]
    gap = 2 * float(np.quantile(widths, 0.9)) if len(widths) else 0.0
    unseen = np.flatnonzero(hidden)
    of_point, of_triangle = facings(np.concatenate(normals)), facings(mesh.area_normals[unseen])
    for facing in np.unique(of_triangle) if len(points) else ():
        near, own = points[of_point == facing], unseen[of_triangle == facing]
        # one point a cell of half the gap is near enough
        cell = np.floor((near - points.min(axis=0)) / (gap / 2)).astype(np.int64)
        _, first = np.unique((cell * (1, 1 << 21, 1 << 42)).sum(axis=1), return_index=True)
        away, _ = cKDTree(near[first]).query(mesh.corners[own].mean(axis=1), distance_upper_bound=gap, workers=-1)
        hidden[own[np.isfinite(away)]] = False
    return hidden


def small_parts(mesh: Mesh, hidden: np.ndarray, met: np.ndarray) -> np.ndarray:
    """(T,) int64 number of the connected part of each triangle, -1 unless all of it is hidden and it is small.

    A bulb in a shade is one, and a light strip: it shines as a whole. Small is what a cell of the grid of the hidden
    triangles that rays ``met`` (T,) could hold, or what has less area. Of many, those count that rays met most.
    """
    part, corners = connected_parts(mesh), mesh.corners
    low, high = np.full((part.max(initial=-1) + 1, 3), np.inf), np.full((part.max(initial=-1) + 1, 3), -np.inf)
    np.minimum.at(low, part, corners.min(axis=1))
    np.maximum.at(high, part, corners.max(axis=1))
    cell = _extent(corners[hidden & (met > 0)].mean(axis=1)) / _PATCH_ROWS
    fits = ((high - low).max(axis=1, initial=0) <= cell) | (np.bincount(part, mesh.areas, len(low)) <= cell**2)
    fits[part[~hidden & (mesh.areas > 0)]] = False
    rays = np.where(fits, np.bincount(part, met, len(low)), 0)
    most = np.argsort(-rays, kind="stable")[:_MOST_PARTS]
    return np.where(hidden & np.isin(part, most[rays[most] > 0]), part, -1)


def _extent(points: np.ndarray) -> float:
    """The longest side of the box around points (N, 3)."""
    return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


def patches_of(mesh: Mesh, hidden: np.ndarray, part: np.ndarray, side: float | None = None) -> Patches:
    """Gather triangles (T,) bool into cells of a grid, by facing; a coarser grid where they would be too many.

    Small parts are gathered by facing alone. ``part`` (T,) is that of `small_parts`. ``side`` of the cells, metres;
    None: a twelfth of what is hidden.
    """
    number, chosen = np.full(len(mesh.triangles), -1, np.int64), np.flatnonzero(hidden)
    if len(chosen) == 0:
        return Patches(number, np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64), 0.0, np.zeros(0, bool), part)
    centers, areas = mesh.corners[chosen].mean(axis=1), mesh.areas[chosen]
    low, extent = centers.min(axis=0), _extent(centers)
    facing = facings(mesh.normals[chosen]).astype(np.int64) // 2
    level = np.round(
        (np.take_along_axis(centers, facing[:, None], 1)[:, 0] - low[facing]) * (_LEVELS / max(extent, 1e-9))
    )
    plane = np.column_stack([connected_parts(mesh)[chosen], facing, level.astype(np.int64)])
    small = part[chosen] >= 0
    plane[small, 1:] = -1
    _, piece = np.unique(plane, axis=0, return_inverse=True)
    piece = piece.reshape(-1)
    size = np.bincount(piece, areas)
    patch, own, least = np.zeros(len(chosen), np.int64), piece, side or max(extent, 1e-9) / _PATCH_ROWS
    for rows in range(_PATCH_ROWS, 0, -1):
        side = least * _PATCH_ROWS / rows
        cell = np.where(small[:, None], 0, np.floor((centers - low) / side)).astype(np.int64)
        own = np.where(small | (size[piece] > side**2), piece, -1)
        _, patch = np.unique(np.column_stack([cell, facing, own]), axis=0, return_inverse=True)
        patch = patch.reshape(-1)
        if len(np.unique(patch[~small])) <= _MOST_PATCHES:
            break
    number[chosen] = patch
    of_patch = np.zeros(int(patch.max()) + 1, np.int64)
    of_patch[patch] = own
    return _gathered(mesh, number, of_patch, float(side or 0.0), part)


def patches_as_before(mesh: Mesh, hidden: np.ndarray, part: np.ndarray, before: np.ndarray) -> Patches:
    """Gather hidden triangles (T,) bool as `patches_of` does, those of guesses of the round before apart.

    ``before`` (T,) is the number of such a guess, -1 for other triangles; at least one triangle of a guess is hidden.
    """
    old = hidden & (before >= 0)
    rest = patches_of(mesh, hidden & ~old, part)
    cells = patches_of(mesh, old, part, rest.side or None)
    patch, own = np.unique(np.column_stack([cells.number[old], before[old]]), axis=0, return_inverse=True)
    number, first = rest.number.copy(), rest.piece.max(initial=-1) + 1
    number[old] = len(rest.area) + own.reshape(-1)
    piece = np.concatenate([rest.piece, first + patch[:, 1]])
    found = _gathered(mesh, number, piece, rest.side or cells.side, part)
    return replace(found, kept=found.piece >= first)


def _gathered(mesh: Mesh, number: np.ndarray, piece: np.ndarray, side: float, part: np.ndarray) -> Patches:
    """Patches by the ``number`` of each triangle; numbers that no triangle has are left out, with their ``piece``."""
    chosen = np.flatnonzero(number >= 0)
    kept, patch = np.unique(number[chosen], return_inverse=True)
    patch, result = patch.reshape(-1), np.full(len(number), -1, np.int64)
    result[chosen] = patch
    centers, areas = mesh.corners[chosen].mean(axis=1), mesh.areas[chosen]
    area = np.bincount(patch, areas, len(kept))
    center = np.stack([np.bincount(patch, areas * centers[:, c], len(kept)) for c in range(3)], axis=1)
    return Patches(result, center / area[:, None], area, piece[kept], side, np.zeros(len(kept), bool), part)
