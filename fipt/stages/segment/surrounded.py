"""Pieces of a mirror: what does not tell its material by itself takes that of the clear metal around it."""

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from fipt.scene.mesh import Mesh
from fipt.stages.segment.material_evidence import HALF, MaterialEvidence, best_trials, is_dielectric, worse
from fipt.stages.segment.surface import surface_of

_FLAT = np.cos(np.radians(30))
"""Cosine of the turn up to which surface goes on: the default of the crease where regions are grown."""
_UNTOLD_ERRORS = 1.0
"""A region of which metal is worse by more standard errors tells its kind."""


def with_surrounded(
    evidence: MaterialEvidence, mesh: Mesh, region: np.ndarray, known: np.ndarray, counted: np.ndarray
) -> MaterialEvidence:
    """The evidence with regions counted as metal that do not tell, and have more border with clear metals than else.

    A mirror shows the room in pieces, and regions are grown by colour. Some pieces show nothing that moves with the
    view. What is metal by its neighbours is a clear neighbour in turn. A metal is clear if the best dielectric is worse
    by more than chance (`worse`): weak proofs are noise in rooms of many regions.

    Parameters
    ----------
    region
        (at most T,) region of each triangle, 0 = unknown; those at the end that are missing are unknown.
    known
        (R,) ids of the regions of the evidence, ascending, one or more.
    counted
        (R,) bool: regions of which most pixels tell; others may be frames of emitters.
    """
    left, products, room = evidence.left, evidence.products, evidence.left.sum(axis=0)
    dielectric, metal = (best_trials(left, room, kind) for kind in (slice(None, HALF), slice(HALF, None)))
    clear = evidence.metal & worse(left, products, dielectric, slice(HALF, None))
    if not clear.any():
        return evidence
    tells = worse(left, products, metal, slice(None, HALF), errors=_UNTOLD_ERRORS)
    tells |= is_dielectric(left, evidence.judged, evidence.usual) | (evidence.judged == 0)
    border, total = _borders(mesh, region, known)
    while True:
        new = ~tells & ~clear & counted & (2 * (border @ clear) > total)
        if not new.any():
            return replace(evidence, metal=evidence.metal | clear)
        clear |= new


def _borders(mesh: Mesh, region: np.ndarray, known: np.ndarray) -> tuple[csr_matrix, np.ndarray]:
    """(R, R) sparse, metres of border that the ``known`` regions have with each other, and (R,) with any regions.

    Where the surface turns is no border, nor is that with surface of no region.
    """
    surface, count = surface_of(mesh), len(known)
    none, unknown = -1, count
    number = np.full(len(surface), none)
    place = np.minimum(np.searchsorted(known, region), count - 1)
    number[: len(region)] = np.where(known[place] == region, place, np.where(region > 0, unknown, none))
    a, b = number[surface.pairs].T
    other = (a != b) & (np.minimum(a, b) > none) & (surface.bend > _FLAT)
    length = csr_matrix((surface.border[other], (a[other], b[other])), shape=(count + 1, count + 1))
    length = length + length.T
    return length[:count, :count], length[:count].sum(axis=1).A1
