"""Regions that fade into each other are of one material: where light is missing, base colours drift, and no edge shows.

Regions are grown where radiance changes, so that the bright surface below a lamp that nobody knows of is a region. Its
base colour is too bright as a whole, but not at its border: a paint ends at an edge, light does not. At places along
the border of two regions, all colours around are fitted by a plane and a step there. Regions fade into each other if
they differ as wholes, and the median step is no more than noise, and less than half of that.
"""

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.scene.voxels import FACINGS
from fipt.stages.segment.material_evidence import CHI_SQUARE, MATTE, ColorPieces

_STEP = 0.5
"""Share of the difference between two regions that is a step at the border of two materials."""
_BORDER = 1.8
"""Voxels between the pieces of two regions that touch, corner to corner."""
_MIXED = 1.0
"""Voxels from the other region within which pieces may be mixed with it."""
_AROUND = 4.5
"""Voxels around a place on the border."""
_PLACE = 3
"""Voxels of one place along the border."""
_FEWEST_PIECES = 4
"""Of either region around a place: a step and a slope are told then."""
_FEWEST_PLACES = 4
"""Along a border: their median is not that of one odd place."""
_SLOPE = 0.5
"""Weight of a slope's square, in pixels times square voxels: few pieces in a row do not tell slope and step apart."""
_MOST_PIXELS = 20
"""Of a piece that count: what is left of its error is not noise."""


def fading(pieces: ColorPieces, label: np.ndarray, variance: np.ndarray, metal: np.ndarray) -> np.ndarray:
    """(R,) int64 material of each region: of those that fade into each other the largest of theirs.

    Parameters
    ----------
    label
        (R,) int64 materials that regions were joined to; -1 for metals that are of none.
    variance
        (R, 3) of the comparable colour of each region.
    metal
        (R,) bool: metals mirror the room, and do not fade.
    """
    use = pieces.judged & ~metal[pieces.owner]
    size = np.bincount(label[pieces.owner[use]], minlength=int(label.max(initial=0)) + 1)
    middle = _medians(pieces, use, len(label))
    pairs = [pair for pair, steps in _borders(pieces, label, use).items() if _fade(pair, steps, middle, variance)]
    if not pairs:
        return label
    group = connected_groups(np.array(pairs).T, len(label))
    order = np.lexsort((size[label], group))
    largest = order[np.append(group[order][1:] != group[order][:-1], True)]
    return label[largest[group]]


def _medians(pieces: ColorPieces, use: np.ndarray, count: int) -> np.ndarray:
    """(R, 3) median colour of the pieces of each region that are of ``use`` (G,); NaN where none is."""
    own = np.flatnonzero(use)[np.argsort(pieces.owner[use], kind="stable")]
    ends = np.searchsorted(pieces.owner[own], np.arange(count + 1))
    result = np.full((count, 3), np.nan)
    for k in np.flatnonzero(np.diff(ends)):
        result[k] = np.median(_colors(pieces)[own[ends[k] : ends[k + 1]]], axis=0)
    return result


def _fade(pair: tuple[int, int], steps: np.ndarray, middle: np.ndarray, variance: np.ndarray) -> bool:
    """Whether the colours of two regions differ, and the median of ``steps`` (K, 3) at their border does not.

    What colour does not keep apart, gloss does.
    """
    if len(steps) < _FEWEST_PLACES:
        return False
    one, other = pair
    step, whole, noise = np.median(steps, axis=0), middle[other] - middle[one], variance[one] + variance[other]
    differ = (whole**2 / noise).sum() >= CHI_SQUARE > (step**2 / noise).sum()
    return bool(differ and np.linalg.norm(step) < _STEP * np.linalg.norm(whole))


def _colors(pieces: ColorPieces) -> np.ndarray:
    """(G, 3) comparable colour of pieces, as if all were matte: glossy ones err alike on both sides of a border."""
    return pieces.color[:, MATTE]


def _borders(pieces: ColorPieces, label: np.ndarray, use: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """Steps of colour (K, 3) along the border of each two regions of different materials that touch.

    Surface that faces one way is looked at by itself; ``use`` (G,) bool are the pieces that count.
    """
    facing, found = pieces.key // len(label) % FACINGS, {}
    for axis in range(FACINGS):
        own = np.flatnonzero(use & (facing == axis))
        if len(own) == 0:
            continue
        near = own[cKDTree(pieces.voxel[own]).query_pairs(_BORDER, output_type="ndarray")]
        regions = pieces.owner[near]
        across = label[regions[:, 0]] != label[regions[:, 1]]
        near, regions = near[across], np.sort(regions[across], axis=1)
        own = own[np.argsort(pieces.owner[own], kind="stable")]
        order = np.lexsort(regions.T[::-1])
        near, regions = near[order], regions[order]
        for rows in np.split(np.arange(len(near)), np.flatnonzero((np.diff(regions, axis=0) != 0).any(axis=1)) + 1):
            if len(rows):
                one, other = regions[rows[0]].tolist()
                ends = np.searchsorted(pieces.owner[own], [one, one + 1, other, other + 1])
                sides = own[ends[0] : ends[1]], own[ends[2] : ends[3]]
                steps = _steps(pieces, *sides, pieces.voxel[near[rows]].mean(axis=1))
                found.setdefault((one, other), []).append(steps)
    return {pair: np.concatenate(steps) for pair, steps in found.items()}


def _steps(pieces: ColorPieces, first: np.ndarray, second: np.ndarray, border: np.ndarray) -> np.ndarray:
    """(K, 3) steps of colour at places along a ``border`` (B, 3), in voxels, from pieces (N,) to pieces (M,)."""
    own, later = np.concatenate([first, second]), np.arange(len(first) + len(second)) >= len(first)
    voxel = pieces.voxel[own].astype(np.float64)
    away = np.empty(len(own))
    for side in (later, ~later):
        away[side], _ = cKDTree(voxel[~side]).query(voxel[side])
    pure = away > _MIXED
    voxel, later, color = voxel[pure], later[pure], _colors(pieces)[own[pure]]
    weight = np.sqrt(np.minimum(pieces.number[own[pure]], _MOST_PIXELS))
    tree, steps = cKDTree(voxel), []
    _, cell = np.unique(np.floor(border / _PLACE), axis=0, return_inverse=True)
    for k in range(int(cell.max()) + 1):
        place = border[cell.reshape(-1) == k].mean(axis=0)
        around = np.array(tree.query_ball_point(place, _AROUND), np.int64)
        count = np.count_nonzero(later[around])
        if min(count, len(around) - count) < _FEWEST_PIECES:
            continue
        terms = np.column_stack([np.ones(len(around)), later[around], voxel[around] - place])
        terms, seen = terms * weight[around, None], color[around] * weight[around, None]
        square = terms.T @ terms + np.diag([0, 0, _SLOPE, _SLOPE, _SLOPE])
        steps.append(np.linalg.solve(square, terms.T @ seen)[1])
    return np.array(steps).reshape(-1, 3)
