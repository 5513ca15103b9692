"""Groups of what is connected, what most of a group say, and quantiles of groups."""

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


def most_frequent(group: np.ndarray, value: np.ndarray, default: np.ndarray) -> np.ndarray:
    """Most frequent value of each group.

    Parameters
    ----------
    group, value
        (N,) int numbers of groups, and values from 0.
    default
        (G,) int: the value of a group that has none, and the one of its equally frequent values that it takes.

    Returns
    -------
    ndarray
        (G,) as ``default``; of other equals the largest value.
    """
    size = int(max(value.max(initial=0), default.max(initial=0))) + 1
    pairs, votes = np.unique(group.astype(np.int64) * size + value, return_counts=True)
    group, value = np.divmod(pairs, size)
    order = np.lexsort((value == default[group], votes))
    result = default.copy()
    result[group[order]] = value[order]  # what has the most votes is written last
    return result


def grouped_median(values: np.ndarray, index: np.ndarray, groups: int) -> np.ndarray:
    """(groups,) or (groups, C) median of ``values`` (N,) or (N, C) per group; every group must have a member."""
    return grouped_quantile(values, index, groups, 0.5)


def grouped_quantile(values: np.ndarray, index: np.ndarray, groups: int, share: float) -> np.ndarray:
    """(groups,) or (groups, C) quantile of ``values`` per group: the mean of the two members around it."""
    if values.ndim == 2:
        return np.stack([grouped_quantile(column, index, groups, share) for column in values.T], axis=1)
    order = np.lexsort((values, index))
    count = np.bincount(index, minlength=groups)
    start = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    place, ordered = share * (count - 1), values[order]
    return 0.5 * (ordered[start + np.floor(place).astype(np.int64)] + ordered[start + np.ceil(place).astype(np.int64)])
