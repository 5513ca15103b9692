"""Which masks of different views are one segment: instance numbers mean nothing beyond their own view.

A *mask* is a segment id of one view. Two masks of different views speak for being one segment by their intersection
over union on the cells that both views look at, measured at a few cells of each mask, so that the cost does not grow
with pixels squared. Masks are then clustered by joining, again and again, the pair of clusters with the most evidence
for it (greedy additive edge contraction, Keuper et al. 2015); two masks of one view speak against it.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from fipt.errors import FiptError
from fipt.stages.segment.settings import FuseSettings

_SAMPLES = 64
"""Cells of each mask at which other views are asked."""
_MOST_SAMPLES = 400_000
"""Of all masks together, as long as each has `_FEWEST_SAMPLES`."""
_FEWEST_SAMPLES = 8
_FEWEST_PIXELS = 4
"""Masks with fewer pixels say nothing and vote for nothing."""
_SAME_VIEW = 1.0
"""Evidence against one segment of two masks that a view tells apart; the most that a pair of views speaks for it is
1 - overlap."""


@dataclass(frozen=True)
class Masks:
    """All masks of all views that vote.

    Attributes
    ----------
    view
        (N,) int64 number of the view, ascending.
    id
        (N,) int64 segment id in its view, ascending within a view.
    kind
        (N,) int64 class, 0 = unknown.
    pixels
        (N,) int64 pixels.
    """

    view: np.ndarray
    id: np.ndarray
    kind: np.ndarray
    pixels: np.ndarray

    def __len__(self) -> int:
        return len(self.view)


CellsOfView = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""Of a view's number: cell (N,) and mask (N,) of its pixels that show a cell and vote."""


def associated(masks: Masks, cells_of: CellsOfView, cells: int, settings: FuseSettings) -> np.ndarray:
    """(N,) int64 segment from 1 of every mask, 0 where it has too few pixels.

    Raises
    ------
    FiptError
        If classes are asked for and there are none.
    """
    if settings.associate == "ids":
        return masks.id.copy()
    if settings.associate == "classes":
        if not masks.kind.any():
            raise FiptError("fuse.associate is classes, but no view has classes", "set fuse.associate: overlap, or ids")
        return masks.kind.copy()
    first, second, evidence = _evidence(masks, cells_of, cells, settings.overlap)
    cluster = contracted(len(masks), first, second, evidence, masks.view)
    segments = np.unique(cluster, return_inverse=True)[1].reshape(-1) + 1
    return np.where(masks.pixels >= _FEWEST_PIXELS, segments, 0)


def _evidence(
    masks: Masks, cells_of: CellsOfView, cells: int, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of masks (E,) < (E,) of different views that overlap, and what speaks for their being one (E,)."""
    own = _sampled(masks, cells_of, cells)
    used = np.unique(own.indices)
    number = np.full(cells, -1, np.int64)
    number[used] = np.arange(len(used))
    own = own[:, used]
    views = int(masks.view.max(initial=-1)) + 1
    both, shared = np.zeros((len(masks), views)), []
    for view in range(views):
        cell, mask = cells_of(view)
        place = number[cell]
        place, mask = place[place >= 0], mask[place >= 0]
        counts = np.bincount(place, minlength=len(used))
        both[:, view] = own @ (counts > 0).astype(np.float64)
        share_of_cells = csr_matrix((1.0 / counts[place], (place, mask)), shape=(len(used), len(masks)))
        found = (own @ share_of_cells).tocoo()
        others = masks.view[found.row] != view
        shared.append((found.row[others], found.col[others], found.data[others]))
    i, j, amount = (np.concatenate(arrays) for arrays in zip(*shared, strict=True))
    i, j = i.astype(np.int64), j.astype(np.int64)
    share = amount / both[i, masks.view[j]]  # of what the other's view sees of i, how much it gives to j
    # of every pair, both directions
    pairs, place = np.unique(np.minimum(i, j) * len(masks) + np.maximum(i, j), return_inverse=True)
    ways = np.zeros((len(pairs), 2))
    ways[place.reshape(-1), (i > j).astype(int)] = share
    first, second = pairs // len(masks), pairs % len(masks)
    with np.errstate(divide="ignore"):
        union = 1 / ways[:, 0] + 1 / ways[:, 1] - 1  # over the intersection
    extent = both / np.maximum(both[np.arange(len(masks)), masks.view], 1)[:, None]
    trust = np.sqrt(extent[first, masks.view[second]] * extent[second, masks.view[first]])
    differ = (masks.kind[first] != masks.kind[second]) & (masks.kind[first] > 0) & (masks.kind[second] > 0)
    return first, second, trust * (1 / union - np.where(differ, (1 + least) / 2, least))


def _sampled(masks: Masks, cells_of: CellsOfView, cells: int) -> csr_matrix:
    """(N, cells) how often each cell was drawn for each mask: evenly over its pixels in the order of cells."""
    count = max(_FEWEST_SAMPLES, min(_SAMPLES, _MOST_SAMPLES // max(len(masks), 1)))
    rows, columns = [], []
    for view in range(int(masks.view.max(initial=-1)) + 1):
        cell, mask = cells_of(view)
        order = np.lexsort((cell, mask))
        cell, mask = cell[order], mask[order]
        present, start, size = np.unique(mask, return_index=True, return_counts=True)
        present, start, size = (values[size >= _FEWEST_PIXELS] for values in (present, start, size))
        step = (np.arange(count) + 0.5) / count
        columns.append(cell[start[:, None] + (step * size[:, None]).astype(np.int64)].reshape(-1))
        rows.append(np.repeat(present, count))
    row, column = np.concatenate(rows), np.concatenate(columns)
    return csr_matrix((np.ones(len(row)), (row, column)), shape=(len(masks), cells))


def contracted(count: int, first: np.ndarray, second: np.ndarray, evidence: np.ndarray, view: np.ndarray) -> np.ndarray:
    """(count,) int64 cluster of each of ``count`` masks: the lowest mask in it.

    Parameters
    ----------
    first, second, evidence
        (E,) pairs of masks, each once, and what speaks for (> 0) or against their being one.
    view
        (count,) view of each mask.
    """
    beside: list[dict[int, float]] = [{} for _ in range(count)]
    for a, b, value in zip(first.tolist(), second.tolist(), evidence.tolist(), strict=True):
        beside[a][b] = beside[b][a] = value
    views = [1 << number for number in view.tolist()]  # of a cluster, as bits
    joined = list(range(count))

    def gain(a: int, b: int) -> float:
        return beside[a][b] - _SAME_VIEW * (views[a] & views[b]).bit_count()

    def offer(a: int, b: int) -> None:
        if (value := gain(a, b)) > 0:
            heapq.heappush(queue, (-value, min(a, b), max(a, b)))

    queue: list[tuple[float, int, int]] = []
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        offer(a, b)
    while queue:
        value, a, b = heapq.heappop(queue)
        if b not in beside[a] or gain(a, b) != -value:
            continue  # of before one of them was joined
        for other, more in beside[b].items():
            del beside[other][b]
            if other != a:
                beside[a][other] = beside[other][a] = beside[a].get(other, 0.0) + more
        beside[b] = {}
        views[a] |= views[b]
        joined[b] = a
        for other in beside[a]:
            offer(a, other)
    cluster = np.array(joined, np.int64)
    while (cluster != cluster[cluster]).any():
        cluster = cluster[cluster]
    return cluster
