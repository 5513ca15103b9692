"""Regions of two materials are cut where the pictures show the border.

A region that was grown on the mesh may hold a mirror and its white frame: they lie in one plane, and what the mirror
shows is white as well. Under a round's shading the two are told apart. Pieces of a region (a voxel, one facing) are
shared out between two materials, each a roughness, a metallic and a colour, such that the description is shortest: what
the materials leave of the pieces, the border, and the second material's parameters. It is cut again, until

- one material is the shorter description. Neighbouring pieces err alike, for shading errs smoothly: what is left counts
  1 / tau, tau being the number of pieces that err as one, which is measured in the room;
- or materials fade into each other: the step at the border is less than half of the difference of the two. So walls
  whose shading drifts stay whole. Where one is clearly a metal and the other one clearly a dielectric a smaller step
  will do: nothing fades from one to the other, but the pieces at the border of a mirror hold some of both.

Halves that turn out to be of one material after all are joined again by `fipt.stages.segment.regroup`.
"""

import logging
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree

from fipt.robust import NORMAL, deviation, spread
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import scene_box
from fipt.scene.segments import LARGEST_ID
from fipt.stages.segment.material_evidence import (
    HALF,
    TRIALS,
    ColorPieces,
    best_trials,
    color_pieces,
    is_dielectric,
    is_metal,
    misfit,
    worse,
)
from fipt.stages.segment.region_pixels import region_pixels

log = logging.getLogger(__name__)

_FEWEST = 6
"""Pieces from which a region may be cut: fewer than a material's parameters and one more tell nothing."""
_TURN = float(np.log(3))
"""Cost of a piece of border: it goes straight on, or turns to either side."""
_ACROSS = 3 / 8
"""Share of the neighbours of a piece that lie across a straight border: of eight around it, three. So many make a piece
of border."""
_LEAST_COLOR = 0.005
"""Least standard deviation of comparable colours."""
_STEP, _STEP_OF_KINDS = 0.5, 0.3
"""Share of the difference between two materials that must be a step at their border. Pieces at the border of a mirror
hold some of both, so that it is lower, 0.33 and more; where light is missing from a part of a wall it was 0.26."""
_KIND_ERRORS = 1.645
"""Standard errors by which a half must be of its kind: 95 % of chance, on the one side that is asked about."""
_ROUNDS = 15
_SWEEPS = 4
"""Most rounds in which materials and pieces are fitted to each other, and sweeps over the pieces in each."""

_Material = tuple[int, np.ndarray]
"""A trial, and a comparable colour (3,)."""


def divided(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]) -> tuple[list[np.ndarray], int, float]:
    """Cut regions of several materials.

    Parameters
    ----------
    regions
        Per shard: (P,) uint16 region of each pixel, 0 = unknown.

    Returns
    -------
    regions
        The same; of a region that was cut the largest material keeps the number, others have new ones.
    cuts
        How many regions there are more.
    alike
        How many pieces of a region err as one.
    """
    center, side = scene_box([shard.samples for shard in shards])
    pixels = region_pixels(shards, regions)
    pixels = pixels.of(np.abs(pixels.place - center).max(axis=1) <= side / 2)  # beyond, a voxel is the whole world
    known, place = np.unique(pixels.region, return_inverse=True)
    result = [own.copy() for own in regions]
    if len(known) == 0:
        return result, 0, 1.0
    pieces = color_pieces(pixels, place.reshape(-1), len(known), center, side)
    free, used = _free_ids(regions), 0
    cuts, alike = materials_of(pieces)
    for number, own, label in cuts:
        count = int(label.max())
        if used + count > len(free):
            log.warning("a region of several materials stays whole: no id up to %d is left", LARGEST_ID)
            continue
        ids = np.concatenate([[known[number]], free[used : used + count]])
        used += count
        tree = cKDTree(pieces.place[own])
        for shard, before, ours in zip(shards, regions, result, strict=True):
            at = np.flatnonzero((before == known[number]) & (np.diff(shard.samples.offsets) > 0))
            if len(at):
                points = np.asarray(shard.samples.position)[np.asarray(shard.samples.offsets)[at]]
                ours[at] = ids[label[tree.query(points)[1]]]
    return result, used, alike


def _free_ids(regions: Sequence[np.ndarray]) -> np.ndarray:
    """Ids that no region has: those above the largest first, then those between."""
    taken = np.unique(np.concatenate([np.zeros(1, np.int64), *map(np.unique, regions)]))
    free = np.setdiff1d(np.arange(LARGEST_ID + 1), taken)
    return np.concatenate([free[free > taken[-1]], free[free < taken[-1]]])


def materials_of(pieces: ColorPieces) -> tuple[list[tuple[int, np.ndarray, np.ndarray]], float]:
    """Number of each region that is cut, its judged pieces (K,), and the material of each (K,), 0 that of most.

    The second value tells how many pieces err as one.
    """
    regions = [np.flatnonzero((pieces.owner == k) & pieces.judged) for k in range(int(pieces.owner.max()) + 1)]
    regions = {k: own for k, own in enumerate(regions) if len(own) >= _FEWEST}
    residual, variance = _scales(pieces, list(regions.values()))
    parts = {k: _Region(pieces, own, residual, variance) for k, own in regions.items()}
    alike, cuts = _alike(list(parts.values())), []
    for number, part in parts.items():
        found = sorted(part.materials(alike), key=len, reverse=True)
        if len(found) > 1:
            label = np.zeros(len(regions[number]), np.int64)
            for k, chosen in enumerate(found):
                label[chosen] = k
            cuts.append((number, regions[number], label))
    return cuts, alike


def _scales(pieces: ColorPieces, regions: list[np.ndarray]) -> tuple[float, np.ndarray]:
    """What ordinary pieces leave under the best trial of their region, and the variance of their colours (3,)."""
    left, spreads = [np.zeros(0)], []
    for own in regions:
        best = (pieces.left[own] * pieces.number[own, None]).sum(axis=0).argmin()
        left.append(pieces.left[own, best])
        color = pieces.color[own, best]
        spreads.append(spread(color))
    every = np.concatenate(left)
    residual = float(deviation(every)) if len(every) else 1.0
    usual = np.median(spreads, axis=0) if spreads else np.ones(3)
    return max(residual, 1e-6), np.maximum(usual, _LEAST_COLOR) ** 2


def _alike(parts: list["_Region"]) -> float:
    """Number of pieces that err as one: one and the neighbours of a piece, times the correlation with them."""
    square = product = 0.0
    for part in parts:
        off = part.cost(part.material())
        off = off - off.mean()
        square += float((off**2).sum())
        product += float((off * (part.near @ off)).sum())  # both ways round
    return 1 + max(product / square, 0.0) if square > 0 else 1.0


class _Region:
    """The pieces of one region, and what materials cost them.

    A piece is one observation of Student's t (3 degrees of freedom): of what a trial leaves of its pixels, and of its
    colour.

    Parameters
    ----------
    pieces, own
        All pieces, and which of them (K,) are the region's.
    residual, variance
        Scale of what a trial leaves, and variance (3,) of the colours, of ordinary pieces.
    """

    def __init__(self, pieces: ColorPieces, own: np.ndarray, residual: float, variance: np.ndarray) -> None:
        self._left, self._residual, self._number = pieces.left[own] / residual, residual, pieces.number[own]
        self._color = color = pieces.color[own]
        voxel = pieces.voxel[own]
        self._odd = voxel.sum(axis=1) % 2 > 0
        pairs = cKDTree(voxel).query_pairs(1.0, p=np.inf, output_type="ndarray")
        ends = np.concatenate([pairs, pairs[:, ::-1]])
        ones = np.ones(len(ends))
        self.near: csr_matrix = coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(len(own),) * 2).tocsr()
        self._border = min(len(own) / max(_ACROSS * len(ends), 1), 1.0) * _TURN
        # texture is what neighbours differ by
        steps = np.abs(color[pairs[:, 0]] - color[pairs[:, 1]]) if len(pairs) else np.zeros((1, *color.shape[1:]))
        self._variance = np.maximum(variance, deviation(steps, axis=0) ** 2 / 2)

    def material(self, chosen: np.ndarray | slice = slice(None)) -> _Material:
        """The material that explains ``chosen`` pieces best."""
        color = np.median(self._color[chosen], axis=0)
        distance = ((self._color[chosen] - color) ** 2 / self._variance).sum(axis=2)
        trial = int(misfit(self._left[chosen], distance).sum(axis=0).argmin())
        return trial, color[trial]

    def cost(self, material: _Material, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(K,) what ``material`` leaves of ``chosen`` pieces."""
        trial, color = material
        distance = ((self._color[chosen, trial] - color) ** 2 / self._variance[trial]).sum(axis=1)
        return misfit(self._left[chosen, trial], distance)

    def materials(self, alike: float) -> list[np.ndarray]:
        """Pieces (K,) of each material; ``alike`` pieces err as one."""
        todo, done = [np.arange(len(self._left))], []
        while todo:
            pieces = todo.pop()
            second = self._second(pieces, alike)
            if second is None:
                done.append(pieces)
            else:
                todo += [pieces[~second], pieces[second]]
        return done

    def _second(self, pieces: np.ndarray, alike: float) -> np.ndarray | None:
        """(K,) bool: which of ``pieces`` (K,) are of a second material; None where there is none."""
        if len(pieces) < _FEWEST:
            return None
        # all costs are in units of pieces: borders and parameters count alike-fold
        border = self._border * alike
        price = alike * (np.log(len(TRIALS)) + 1.5 * np.log(len(pieces)))
        near = self.near[pieces][:, pieces]
        shortest, best = float(self.cost(self.material(pieces), pieces).sum()) - price, None
        for start in self._starts(pieces):
            found = self._shared_out(pieces, near, start, border)
            if found is not None and found[0] < shortest:
                shortest, best = found
        if best is None:
            return None
        step = self._step(pieces, near, best)
        sound = step > _STEP or (step > _STEP_OF_KINDS and self._of_two_kinds(pieces, best, alike))
        return best if sound else None

    def _starts(self, pieces: np.ndarray) -> Iterator[np.ndarray]:
        """Guesses (K,) bool of a second material: metal, another colour, what one material explains badly."""
        left = misfit(self._left[pieces])
        yield left[:, HALF:].min(axis=1) < left[:, :HALF].min(axis=1)
        matte = left[:, :HALF].sum(axis=0).argmin()
        color = self._color[pieces, matte] / np.sqrt(self._variance[matte])
        color = color - np.median(color, axis=0)
        yield _halves(color @ np.linalg.svd(color, full_matrices=False)[2][0])
        cost = self.cost(self.material(pieces), pieces)
        yield cost > np.median(cost) + 2 * spread(cost)

    def _shared_out(
        self, pieces: np.ndarray, near: csr_matrix, start: np.ndarray, border: float
    ) -> tuple[float, np.ndarray] | None:
        """Share ``pieces`` out between two materials, from a guess on: the cost, and who has the second."""
        second = start.copy()
        for _ in range(_ROUNDS):
            if second.all() or not second.any():
                return None
            cost = [self.cost(self.material(pieces[own]), pieces) for own in (~second, second)]
            before = second.copy()
            for _ in range(_SWEEPS):
                for turn in (self._odd[pieces], ~self._odd[pieces]):
                    beside = near @ np.stack([~second, second], axis=1).astype(np.float64)
                    rather = cost[1] + border * beside[:, 0] < cost[0] + border * beside[:, 1]
                    second = np.where(turn, rather, second)
            if (second == before).all():
                break
        if second.all() or not second.any():
            return None
        total = sum(float(self.cost(self.material(pieces[own]), pieces[own]).sum()) for own in (~second, second))
        return total + border * float((near @ second.astype(np.float64))[~second].sum()), second

    def _of_two_kinds(self, pieces: np.ndarray, second: np.ndarray, alike: float) -> bool:
        """Whether one of the two materials (K,) is clearly a metal, and the other one clearly a dielectric."""
        halves = [pieces[own] for own in (~second, second)]
        judged = np.array([self._number[half].sum() for half in halves])
        rows = [self._number[half, None] * self._left[half] * self._residual for half in halves]
        left = np.stack([row.sum(axis=0) for row in rows])
        products = alike * np.stack([row.T @ row for row in rows])
        usual = judged * self._residual / NORMAL
        dielectrics, metals = slice(None, HALF), slice(HALF, None)
        best = [best_trials(left, left.sum(axis=0), kind) for kind in (dielectrics, metals)]
        metal = is_metal(left, judged, usual) & worse(left, products, best[0], metals, _KIND_ERRORS)
        dielectric = is_dielectric(left, judged, usual) & worse(left, products, best[1], dielectrics, _KIND_ERRORS)
        return bool((metal & dielectric[::-1]).any())

    def _step(self, pieces: np.ndarray, near: csr_matrix, second: np.ndarray) -> float:
        """Share of the difference of two materials (K,) that is a step where they meet; infinite if they never do."""
        cost = [self.cost(self.material(pieces[own]), pieces) for own in (~second, second)]
        gain = cost[0] - cost[1]
        pairs = near.tocoo()
        across = ~second[pairs.row] & second[pairs.col]
        if not across.any():
            return float("inf")
        step = gain[pairs.col[across]] - gain[pairs.row[across]]
        return float(np.median(step) / max(np.median(gain[second]) - np.median(gain[~second]), 1e-12))


def _halves(values: np.ndarray) -> np.ndarray:
    """(K,) bool: the upper of two groups of values (K,), cut midway between their medians."""
    upper = values > np.median(values)
    for _ in range(_ROUNDS):
        if upper.all() or not upper.any():
            break
        upper = values > (np.median(values[upper]) + np.median(values[~upper])) / 2
    return upper
