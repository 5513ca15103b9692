"""Borders between parts move to where the pictures show that materials meet.

Growing ends a region where the mesh turns or a picture has an edge. On a scan a mirror lies in the plane of its wall,
and grooves are smooth, so that regions end some pixels off, or not at all. Once materials are known, each triangle is
asked again: which of the parts that touch it explains best what the views show of it? Borders cost their length, so a
triangle changes over for evidence only. The front of a part moves on as long as there is some: what is known of a
mirror by its corner spreads over the mirror.

The cost of a triangle is that of a piece in `fipt.stages.segment.divide`, counted once for each square pixel of its
area. Parts keep the material that they have at the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.robust import deviation, spread
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import scene_box, segments_of_triangles
from fipt.stages.segment.material_evidence import misfit, tried
from fipt.stages.segment.region_pixels import RegionPixels, region_pixels
from fipt.stages.segment.surface import surface_of

_TURN = float(np.log(3))
"""Cost of a pixel's width of border: it goes straight on, or turns to either side."""
_FEWEST = 20
"""Triangles from which a part tells how much its colours differ; the others differ as those do."""
_LEAST = 1e-6
"""Of what is left, and of colours: smaller deviations are none."""
_SWEEPS = 30
"""Most times that all triangles are asked; a front moves on by one triangle or two in each."""


@dataclass(frozen=True)
class _Triangles:
    """C triangles that pixels fill with one part.

    ``triangle`` (C,) numbers; ``part`` (C,); ``left`` (C, T) and ``color`` (C, T, 3) of `material_evidence.tried`;
    ``area`` (C,) in pixels; ``ends`` (E, 2) neighbours, both ways round, and the ``border`` (E,) they share, in pixels.
    """

    triangle: np.ndarray
    part: np.ndarray
    left: np.ndarray
    color: np.ndarray
    area: np.ndarray
    ends: np.ndarray
    border: np.ndarray


def borders_moved(mesh: Mesh, shards: Sequence[ObservedShard], parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Give triangles to the neighbouring part that explains them best.

    Parameters
    ----------
    parts
        Per shard: (P,) uint16 part of each pixel, 0 = unknown.

    Returns
    -------
    Per shard: (P,) uint16, the same but for pixels whose triangle changed over. Pixels that have another part than most
    of their triangle keep it.
    """
    center, side = scene_box([shard.samples for shard in shards])
    pixels = region_pixels(shards, parts)
    pixels = pixels.of(np.abs(pixels.place - center).max(axis=1) <= side / 2)
    most, before = segments_of_triangles([shard.samples for shard in shards], parts)
    if most == 0 or len(pixels.region) == 0:
        return list(parts)
    cells = _cells(mesh, shards, pixels, before)
    after = before.copy()
    after[cells.triangle] = _relabelled(cells, most + 1)
    result = []
    for shard, own in zip(shards, parts, strict=True):
        samples = shard.samples
        first = np.asarray(samples.offsets[:-1])
        shown = np.flatnonzero((np.diff(samples.offsets) > 0) & (np.asarray(samples.center) > 0))
        triangle = np.asarray(samples.triangle[first[shown]])
        moved = (own[shown] == before[triangle]) & (after[triangle] != before[triangle])
        ours = own.copy()
        ours[shown[moved]] = after[triangle[moved]]
        result.append(ours)
    return result


def _cells(mesh: Mesh, shards: Sequence[ObservedShard], pixels: RegionPixels, part: np.ndarray) -> _Triangles:
    """The triangles that ``pixels`` show, of the parts (T,), with what they say of each."""
    width = float(np.median(np.concatenate([shard.samples.footprint for shard in shards])))
    triangle, cell = np.unique(pixels.triangle, return_inverse=True)
    left, color = tried(pixels, cell.reshape(-1), len(triangle))
    surface = surface_of(mesh)
    place = np.full(len(mesh.triangles), -1)
    place[triangle] = np.arange(len(triangle))
    pairs = place[surface.pairs]
    known = (pairs >= 0).all(axis=1)
    ends = np.concatenate([pairs[known], pairs[known][:, ::-1]])
    border = np.tile(surface.border[known] / width, 2)
    area = mesh.areas[triangle] / width**2
    return _Triangles(triangle, part[triangle].astype(np.int64), left, color, area, ends, border)


def _relabelled(cells: _Triangles, parts: int) -> np.ndarray:
    """(C,) part of each cell, of so many ``parts``: in turns, half of the cells take the cheapest part around them."""
    cost = _PartCosts(cells, parts)
    part = cells.part.copy()
    odd = cells.triangle[cells.ends[:, 0]] % 2 > 0
    for _ in range(_SWEEPS):
        before = part.copy()
        for turn in (odd, ~odd):
            a, b = cells.ends.T
            mixed = np.zeros(len(part), bool)
            mixed[a[turn & (part[a] != part[b])]] = True
            asked, own = mixed[a], np.flatnonzero(mixed)
            a, b, border = a[asked], b[asked], cells.border[asked]
            key, row = np.unique(np.r_[a * parts + part[b], own * parts + part[own]], return_inverse=True)
            cell, other = key // parts, key % parts
            inside = np.bincount(row.reshape(-1)[: len(a)], border, len(key))
            total = cost.of(cell, other) + _TURN * (np.bincount(a, border, len(part))[cell] - inside)
            order = np.lexsort((total, cell))
            best = order[np.flatnonzero(np.diff(cell[order], prepend=-1))]
            part[cell[best]] = other[best]
        if (part == before).all():
            break
    return part


class _PartCosts:
    """What parts cost the cells, with the trial and the colour that explain the cells of each best."""

    def __init__(self, cells: _Triangles, parts: int) -> None:
        self._cells = cells
        self._trial = np.zeros(parts, np.int64)
        self._color, self._variance = np.zeros((parts, 3)), np.zeros((parts, 3))
        order = np.argsort(cells.part, kind="stable")
        bounds = np.searchsorted(cells.part[order], np.arange(parts + 1))
        counts = np.diff(bounds)
        for k in np.flatnonzero(counts):
            own = order[bounds[k] : bounds[k + 1]]
            trial = self._trial[k] = (cells.left[own] * cells.area[own, None]).sum(axis=0).argmin()
            color = cells.color[own, trial]
            self._color[k] = np.median(color, axis=0)
            self._variance[k] = spread(color) ** 2
        some = counts >= min(_FEWEST, counts.max())
        self._variance = np.maximum(self._variance, np.maximum(np.median(self._variance[some], axis=0), _LEAST))
        best = cells.left[np.arange(len(cells.part)), self._trial[cells.part]]
        self._residual = max(float(deviation(best)), _LEAST)
        self._known = counts > 0

    def of(self, cell: np.ndarray, part: np.ndarray) -> np.ndarray:
        """(N,) cost of giving cells (N,) to parts (N,); infinite for a part of which nothing is known."""
        trial = self._trial[part]
        off = self._cells.color[cell, trial] - self._color[part]
        square = (off**2 / self._variance[part]).sum(axis=1)
        cost = misfit(self._cells.left[cell, trial] / self._residual, square)
        return np.where(self._known[part], self._cells.area[cell] * cost, np.inf)
