"""Regions that fade into each other are of one material: where light is missing, base colours drift, and no edge shows.

Regions are grown where radiance changes, so that the bright surface below a lamp that nobody knows of is a region. Its
base colour is too bright as a whole, but not at its border: a paint ends at an edge, light does not. At places along
the border of two regions, all colours around are fitted by a plane and a step there. Regions fade into each other if
the median step is no more than noise, and less than half of what they differ by as wholes.
"""

from collections.abc import Iterator

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
_FEWEST_PLACES = 5
"""Along a border: their median is not that of one odd place."""
_SLOPE = 0.5
"""Weight of a slope's square, in pieces: few pieces in a row do not tell slope and step apart."""
_MOST_PIXELS = 20
"""Of a piece that count: what is left of its error is not noise."""


def fading(pieces: ColorPieces, label: np.ndarray, variance: np.ndarray, metal: np.ndarray) -> np.ndarray:
    """(R,) int64 material of each region: of those that fade into each other that of the largest.

    Parameters
    ----------
    label
        (R,) int64 materials that regions were joined to.
    variance
        (R, 3) of the comparable colour of each region.
    metal
        (R,) bool: metals mirror the room, and do not fade.
    """
    size = np.bincount(pieces.owner, pieces.judged, len(label))
    pairs = [pair for pair, steps in _borders(pieces, label, metal) if _fade(pieces, pair, steps, variance)]
    if not pairs:
        return label
    group = connected_groups(np.array(pairs).T, len(label))
    order = np.lexsort((size, group))
    largest = order[np.append(group[order][1:] != group[order][:-1], True)]
    return label[largest[group]]


def _fade(pieces: ColorPieces, pair: tuple[int, int], steps: np.ndarray, variance: np.ndarray) -> bool:
    """Whether the median of ``steps`` (K, 3) is noise, and small against what the two regions differ by."""
    if len(steps) < _FEWEST_PLACES:
        return False
    step = np.median(steps, axis=0)
    one, other = (np.median(_colors(pieces)[pieces.judged & (pieces.owner == k)], axis=0) for k in pair)
    noise = (step**2 / variance[list(pair)].sum(axis=0)).sum() < CHI_SQUARE
    return bool(noise and np.linalg.norm(step) < _STEP * np.linalg.norm(other - one))


def _colors(pieces: ColorPieces) -> np.ndarray:
    """(G, 3) comparable colour of pieces, as if all were matte: glossy ones err alike on both sides of a border."""
    return pieces.color[:, MATTE]


def _borders(pieces: ColorPieces, label: np.ndarray, metal: np.ndarray) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """Yield, for each facing, two regions of different materials that touch, and the steps (K, 3) between them."""
    facing = pieces.key // len(label) % FACINGS
    use = pieces.judged & ~metal[pieces.owner]
    for axis in range(FACINGS):
        own = np.flatnonzero(use & (facing == axis))
        if len(own) == 0:
            continue
        near = own[cKDTree(pieces.voxel[own]).query_pairs(_BORDER, output_type="ndarray")]
        regions = pieces.owner[near]
        across = label[regions[:, 0]] != label[regions[:, 1]]
        near, regions = near[across], np.sort(regions[across], axis=1)
        found, index = np.unique(regions, axis=0, return_inverse=True)
        for k, (one, other) in enumerate(found.tolist()):
            middle = pieces.voxel[near[index.reshape(-1) == k]].mean(axis=1)
            beside = own[np.isin(pieces.owner[own], (one, other))]
            yield (one, other), _steps(pieces, beside, pieces.owner[beside] == other, middle)


def _steps(pieces: ColorPieces, own: np.ndarray, second: np.ndarray, border: np.ndarray) -> np.ndarray:
    """(K, 3) steps of colour at places along a ``border`` (B, 3), in voxels, from the first region to the ``second``.

    ``own`` (N,) are the pieces of both, ``second`` (N,) bool which are of the second.
    """
    voxel = pieces.voxel[own].astype(np.float64)
    away = np.empty(len(own))
    for side in (second, ~second):
        away[side], _ = cKDTree(voxel[~side]).query(voxel[side])
    pure = away > _MIXED
    voxel, second, color = voxel[pure], second[pure], _colors(pieces)[own[pure]]
    weight = np.sqrt(np.minimum(pieces.number[own[pure]], _MOST_PIXELS))
    tree, steps = cKDTree(voxel), []
    _, cell = np.unique(np.floor(border / _PLACE), axis=0, return_inverse=True)
    for k in range(int(cell.max()) + 1):
        place = border[cell.reshape(-1) == k].mean(axis=0)
        around = np.array(tree.query_ball_point(place, _AROUND), np.int64)
        count = np.count_nonzero(second[around])
        if min(count, len(around) - count) < _FEWEST_PIECES:
            continue
        terms = np.column_stack([np.ones(len(around)), second[around], voxel[around] - place])
        terms, seen = terms * weight[around, None], color[around] * weight[around, None]
        square = terms.T @ terms + np.diag([0, 0, _SLOPE, _SLOPE, _SLOPE])
        steps.append(np.linalg.solve(square, terms.T @ seen)[1])
    return np.array(steps).reshape(-1, 3)
