"""Groups of what is connected."""

from collections.abc import Sequence

import numpy as np


def connected_groups(pairs: Sequence[np.ndarray] | np.ndarray, count: int) -> np.ndarray:
    """(count,) int64 number of the group of each of ``count`` things, of which pairs (2, N) belong together.

    Groups are numbered by their first member.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    links = coo_matrix((np.ones(len(pairs[0]), np.int8), (pairs[0], pairs[1])), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)
