"""Copies: one shape in several places, as a modeller sets up the chairs of a classroom. They judge together.

Copies are of one kind, metal or not, and where their colours agree of one material. So one that few pixels show is
known by the others. The mesh of a scan or of photographs has hardly any: its pieces are not alike.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from fipt.formats.files import check_memory
from fipt.groups import connected_groups
from fipt.stages.segment.material_evidence import CHI_SQUARE, HALF, MaterialEvidence, is_metal, worse

_SAME_PLACE = 0.5
"""Share of the smaller region's triangles that two regions must have in common, on the shape."""
_BYTES = 300
"""Of a pair of copies that are compared."""


def judged_with_copies(evidence: MaterialEvidence, copies: np.ndarray) -> MaterialEvidence:
    """The evidence of regions, with what copies tell each other of being metal.

    Those that agree in colour are all metal or none, as most of their pixels have it; regions that agree with one third
    are of one group, however far apart. A region has no vote if it has no piece that judges a trial; where nobody has,
    all stay as they were. And all of a shape are metal, whatever their colours, if what trials leave of them proves it
    together; but not one that clearly is none.

    Parameters
    ----------
    copies
        (2, N) pairs of regions, as of `copied_regions`.

    Raises
    ------
    FiptError
        If there are more pairs than memory holds.
    """
    own, other = copies
    check_memory(_BYTES * len(own), "the comparison of copies", "raise fuse.smallest, or set regroup.ids: none")
    trial = (evidence.left[own] + evidence.left[other]).argmin(axis=1)
    off = evidence.color[own, trial] - evidence.color[other, trial]
    agree = (off**2 / (evidence.variance[own] + evidence.variance[other])).sum(axis=1) < CHI_SQUARE
    pixels = evidence.pixels * (evidence.left > 0).any(axis=1)
    thing = connected_groups((own[agree], other[agree]), len(pixels))
    metal, votes = np.bincount(thing, pixels * evidence.metal)[thing], np.bincount(thing, pixels)[thing]
    voted = np.where(votes > 0, metal > 0.5 * votes, evidence.metal)

    shape = connected_groups((own, other), len(pixels))
    left = np.stack([np.bincount(shape, column) for column in evidence.left.T], axis=1)
    judged, usual = np.bincount(shape, evidence.judged), np.bincount(shape, evidence.usual)
    proved = is_metal(left, judged, usual) & (np.bincount(shape) > 1)
    best = HALF + left[:, HALF:].argmin(axis=1)
    refused = worse(evidence.left, evidence.products, best[shape], slice(None, HALF))
    return replace(evidence, metal=voted | (proved[shape] & ~refused))


def copied_regions(
    first: np.ndarray, region: np.ndarray, known: np.ndarray, others: np.ndarray | None = None
) -> np.ndarray:
    """(2, N) int64 pairs of regions that are the same place of two copies, as numbers into ``known``.

    A region that holds several places of its copy is paired with the regions of each of them on another.

    Parameters
    ----------
    first
        (T,) as of `first_copies`.
    region
        (at most T,) region of each triangle, 0 = unknown; those at the end that are missing are unknown.
    known
        (R,) ids of regions, ascending.
    others
        (S,) ids, ascending, none of them in ``known``: the second of each pair is of these, as a number into them.
        None: both are of ``known``, the lower one first.
    """
    own, size = _copied_triangles(first, region, known)
    other, other_size = (own, size) if others is None else _copied_triangles(first, region, others)
    common = (own @ other.T).tocoo()
    least = _SAME_PLACE * np.minimum(size[common.row], other_size[common.col])
    same = (common.data > least) & ((common.row < common.col) | (others is not None))
    return np.stack([common.row[same], common.col[same]]).astype(np.int64)


def _copied_triangles(first: np.ndarray, region: np.ndarray, known: np.ndarray) -> tuple[csr_matrix, np.ndarray]:
    """(R, T) 1 where a region has a copy of a triangle, and (R,) how many triangles the region has."""
    first = first[: len(region)]
    # a piece may be a copy of one whose triangles come later in the file
    shape = (len(known), int(first.max(initial=0)) + 1)
    if len(known) == 0:
        return csr_matrix(shape), np.zeros(0, np.int64)
    number = np.minimum(np.searchsorted(known, region), len(known) - 1)
    own = known[number] == region
    copied = own & (np.bincount(first)[first] > 1)
    triangles = coo_matrix((np.ones(copied.sum()), (number[copied], first[copied])), shape=shape).tocsr()
    triangles.data[:] = 1
    return triangles, np.bincount(number[own], minlength=len(known))


def votes_of_copies(copies: np.ndarray, label: np.ndarray, votes: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(R, labels) votes that the copies of each region have for each label.

    Parameters
    ----------
    copies
        (2, N) pairs of a region and one of S others, as of `copied_regions`.
    label, votes
        (S,) of the others.
    shape
        R and the number of labels.
    """
    own, other = copies
    return np.bincount(own * shape[1] + label[other], votes[other], shape[0] * shape[1]).reshape(shape)
