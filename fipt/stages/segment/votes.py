"""Votes: the ids that views give to pixels, counted by cell, and what a cell is believed to be."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from fipt.errors import FiptError
from fipt.formats.arrays import on_disk
from fipt.scene.segments import LARGEST_ID
from fipt.stages.segment.associate import Masks
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.views import CellObservations, view_ids, without_speckles

log = logging.getLogger(__name__)

_STEPS, _REACH = (-2, 0, 2), 2
"""Rows and columns beside a pixel where its id may be from, and the furthest."""
_TRUST = 10.0
"""Votes of a cell that count as much as what its region says."""
_STAYS = 0.01
"""Least share of a segment that a pixel's own cell is taken to have."""
_FEWEST_PIXELS = 4
"""Pixels that two segments must each have on a triangle in a view before it is cut."""


class VoteMasks:
    """The ids that views give to pixels; read once, and kept on the disk beside ``folder``.

    Parameters
    ----------
    folder
        Of VIEW.npz.
    observations
        What the voting views show; may be exchanged for finer cells of the same views.

    Attributes
    ----------
    masks
        Of all views.
    without_segments
        Names of views without any segment.
    """

    def __init__(self, folder: Path, observations: CellObservations, settings: FuseSettings) -> None:
        self.observations, self.settings = observations, settings
        self._mask = on_disk(folder.parent)(observations.cell.shape, np.int32)
        view, ids, kinds, pixels = [], [], [], []
        self.without_segments: list[str] = []
        count = 0
        for number, camera in enumerate(observations.cameras):
            labels, classes = view_ids(folder, camera, settings.other_size)
            if settings.speckles:
                labels = without_speckles(labels)
            labels = labels.reshape(-1)
            present, size = np.unique(labels[labels > 0], return_counts=True)
            if len(present) == 0:
                self.without_segments.append(camera.name)
            table = np.full(LARGEST_ID + 1, -1, np.int32)
            table[present] = count + np.arange(len(present))
            self._mask[observations.pixels(number)] = table[labels]
            count += len(present)
            view.append(np.full(len(present), number))
            ids.append(present.astype(np.int64))
            kinds.append(classes[present].astype(np.int64))
            pixels.append(size)
        if len(self.without_segments) == len(observations.cameras):
            raise FiptError(f"no view of {folder} has a segment", "check what wrote the ids")
        if self.without_segments:
            log.warning("views without any segment: %s", ", ".join(self.without_segments))
        self.masks = Masks(*(np.concatenate(arrays) for arrays in (view, ids, kinds, pixels)))

    def of(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixel (N,), its mask (N,) and weight (N,) of all pixels of a view that vote."""
        cell, cosine = self.observations.of(number)
        mask = np.asarray(self._mask[self.observations.pixels(number)])
        pixel = np.flatnonzero((cell >= 0) & (mask >= 0))
        weight = np.ones(len(pixel)) if self.settings.vote == "count" else cosine[pixel].astype(np.float64)
        return pixel, mask[pixel].astype(np.int64), weight

    def cells_of(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Cell (N,) and mask (N,) of all pixels of a view that vote."""
        pixel, mask, _ = self.of(number)
        return self.observations.of(number)[0][pixel], mask


@dataclass(frozen=True)
class Belief:
    """What cells were given so far: of each cell, and of the region that it lies in, the two most voted segments.

    Attributes
    ----------
    region
        (C,) region of each cell.
    label, share
        Of cells (C, 2): the segments and their share of the votes; -1 where there is none.
    region_label, region_share
        The same of regions (R, 2).
    own
        (C,) weight of the cell's share against its region's: the more votes, the more.
    """

    region: np.ndarray
    label: np.ndarray
    share: np.ndarray
    region_label: np.ndarray
    region_share: np.ndarray
    own: np.ndarray

    def of(self, cell: np.ndarray, label: np.ndarray) -> np.ndarray:
        """Belief that cells have a segment; arrays of one shape."""
        region, own = self.region[cell], self.own[cell]
        result = np.zeros(cell.shape, np.float32)
        for k in (0, 1):
            result += np.where(self.label[cell, k] == label, own * self.share[cell, k], 0)
            result += np.where(self.region_label[region, k] == label, (1 - own) * self.region_share[region, k], 0)
        return result


def believed(votes: csr_matrix, region: np.ndarray) -> Belief:
    """What the votes (C, S + 1) so far say of cells and of their regions (C,)."""
    count = len(region)
    cells = csr_matrix((np.ones(count), (region, np.arange(count))), shape=(int(region.max()) + 1, count))
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    return Belief(
        region, *_two_best(votes), *_two_best(csr_matrix(cells @ votes)), (total / (total + _TRUST)).astype(np.float32)
    )


def _two_best(votes: csr_matrix) -> tuple[np.ndarray, np.ndarray]:
    """The two columns with the most votes of each row (N, 2) int32, -1 where there is none, and their shares (N, 2)."""
    first, share, _ = most_votes(votes)
    others = votes.copy()
    others.data[others.indices == np.repeat(first, np.diff(votes.indptr))] = 0
    second, _, _ = most_votes(others)
    shares = np.stack([share, share_of(others, second) * (1 - share)], axis=1).astype(np.float32)
    return np.where(shares > 0, np.stack([first, second], axis=1), -1).astype(np.int32), shares


def votes_of(
    vote_masks: VoteMasks, number: int, segment: np.ndarray, belief: Belief | None, shape: tuple[int, int]
) -> csr_matrix:
    """Votes (C, S + 1) of a view.

    A pixel votes for the cell that it shows. Where a ``belief`` is known, pixels near edges vote for the cells around,
    in proportion to how much those are believed to have its segment: edges of masks are uncertain by some pixels, and
    what is said of a window frame is not for the pane beside it (expectation maximisation over where the id is from).
    """
    pixel, mask, weight = vote_masks.of(number)
    label = segment[mask]
    pixel, label, weight = pixel[label > 0], label[label > 0], weight[label > 0]
    camera, cell = vote_masks.observations.cameras[number], vote_masks.observations.of(number)[0]
    if belief is None:
        return csr_matrix((weight, (cell[pixel], label)), shape=shape)
    padded = np.pad(cell.reshape(camera.height, camera.width), _REACH, constant_values=-1).ravel()
    place = (pixel // camera.width + _REACH) * (camera.width + 2 * _REACH) + pixel % camera.width + _REACH
    steps = [y * (camera.width + 2 * _REACH) + x for y in _STEPS for x in _STEPS]
    won = np.where(padded >= 0, belief.label[padded, 0], -1)
    inside = np.ones(len(place), bool)
    for step in steps:
        inside &= won[place + step] == label
    edge = ~inside
    around = np.stack([padded[place[edge] + step] for step in steps], axis=1)
    share = np.where(around >= 0, belief.of(around, label[edge, None]), 0)
    share[:, len(steps) // 2] += _STAYS
    share *= (weight[edge] / share.sum(axis=1))[:, None]
    values = np.concatenate([weight[inside], share.ravel()])
    rows = np.concatenate([cell[pixel[inside]], np.maximum(around, 0).ravel()])
    columns = np.concatenate([label[inside], np.repeat(label[edge], len(steps))])
    return csr_matrix((values, (rows, columns)), shape=shape)


def disputed(vote_masks: VoteMasks, count: int) -> np.ndarray:
    """(count,) bool: triangles of which a view shows two segments."""
    found = np.zeros(count, bool)
    for number in range(len(vote_masks.observations.cameras)):
        cell, mask = vote_masks.cells_of(number)
        keys, pixels = np.unique(cell.astype(np.int64) << 32 | mask, return_counts=True)
        triangle = keys[pixels >= _FEWEST_PIXELS] >> 32
        found[triangle[1:][triangle[1:] == triangle[:-1]]] = True
    return found


def most_votes(votes: csr_matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Winner of each row of votes (C, S): its column (the first of equals), its share of the votes, and all votes.

    Rows without votes have winner and share 0.
    """
    votes.sort_indices()
    sizes = np.diff(votes.indptr)
    rows = np.flatnonzero(sizes)
    winner, share = np.zeros(len(sizes), np.int64), np.zeros(len(sizes))
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    if len(rows):
        most = np.maximum.reduceat(votes.data, votes.indptr[rows])
        owner = np.repeat(np.arange(len(rows)), sizes[rows])
        best = np.flatnonzero(votes.data == most[owner])[::-1]
        winner[rows[owner[best]]] = votes.indices[best]  # the last write, the first of equals, stays
        share[rows] = most / np.maximum(total[rows], 1e-30)
    return winner, share, total


def share_of(votes: csr_matrix, ids: np.ndarray) -> np.ndarray:
    """(C,) share that the column ``ids`` (C,) has of the votes (C, S) in each row; 0 where there are none."""
    row = np.repeat(np.arange(len(ids)), np.diff(votes.indptr))
    own = votes.indices == ids[row]
    got = np.bincount(row[own], votes.data[own], len(ids))
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    return got / np.where(total > 0, total, 1)
