"""Slivers: regions so narrow that no pixel shows them alone. What touches among them becomes one region.

Growing parts a chair's leg into the faces that it is made of, since they turn. No view tells such faces apart, and none
fills a pixel, so that nothing is known of their material. The leg as a whole may fill one.
"""

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from fipt.groups import connected_groups
from fipt.stages.segment.surface import CellSurface
from fipt.stages.segment.views import CellObservations

_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


def without_slivers(surface: CellSurface, ids: np.ndarray, observations: CellObservations) -> np.ndarray:
    """(C,) int64 region from 1 of every cell: slivers that touch are one region.

    Parameters
    ----------
    ids
        (C,) int64 region of every cell, from 0 or 1.
    """
    ids = np.unique(ids, return_inverse=True)[1].reshape(-1)
    sliver = ~_wide(ids, observations)
    a, b = ids[surface.pairs].T
    touching = sliver[a] & sliver[b]
    return connected_groups((a[touching], b[touching]), len(sliver))[ids] + 1


def _wide(ids: np.ndarray, observations: CellObservations) -> np.ndarray:
    """(R,) bool: some view shows the region at a pixel and at the four beside it, or none shows it at all."""
    count = int(ids.max(initial=-1)) + 1
    wide, seen = np.zeros(count, bool), np.zeros(count, bool)
    for number, camera in enumerate(observations.cameras):
        cell, _ = observations.of(number)
        shown = np.where(cell >= 0, ids[cell], -1).reshape(camera.height, camera.width)
        inside = (minimum_filter(shown, footprint=_CROSS) == maximum_filter(shown, footprint=_CROSS)) & (shown >= 0)
        wide[shown[inside]], seen[shown[shown >= 0]] = True, True
    return wide | ~seen
