"""Maps of what pixels see outside, by direction."""

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from fipt.scene.environment import EnvironmentMap
from fipt.stages.environment.unseen import sphere_edges


def directional_mean(
    directions: np.ndarray, radiance: np.ndarray, weight: np.ndarray, clipped: np.ndarray, rows: int, up: str = "y"
) -> tuple[np.ndarray, np.ndarray]:
    """Average pixels by direction, in the texels of a map of ``rows`` x 2 ``rows``.

    A bound below what others measure in its texel says nothing new and counts as they do; where there are only bounds,
    the radiance is at least the highest of them.

    Parameters
    ----------
    directions, radiance
        (N, 3) unit world directions and observed radiance.
    weight
        (N,) positive.
    clipped
        (N,) bool: the radiance is only a lower bound.

    Returns
    -------
    mean
        (rows, 2 rows, 3) mean radiance, 0 where nothing is seen.
    seen
        (rows, 2 rows) bool: whether a pixel looks along the texel.
    """
    shape = (rows, 2 * rows)
    place = EnvironmentMap("map", np.zeros((*shape, 3), np.float32), up).texels(directions)
    row, column = np.floor(place).astype(np.int64).T
    texel = np.minimum(row, rows - 1) * 2 * rows + column % (2 * rows)
    exact, highest = ~clipped, np.zeros((2 * rows**2, 3))
    np.maximum.at(highest, texel[clipped], radiance[clipped])
    measured, total = _texel_means(texel[exact], radiance[exact], weight[exact], len(highest))
    least = np.where(total[:, None] > 0, measured, highest)
    raised = np.where(clipped[:, None], np.maximum(radiance, least[texel]), radiance)
    mean, total = _texel_means(texel, raised, weight, len(highest))
    return mean.reshape(*shape, 3), (total > 0).reshape(shape)


def _texel_means(
    texel: np.ndarray, radiance: np.ndarray, weight: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (count, 3) of the pixels (N,) of each texel, and the sum of their weights (count,)."""
    total = np.bincount(texel, weight, count)
    sums = [np.bincount(texel, weight * radiance[:, c], count) for c in range(3)]
    return np.stack(sums, axis=1) / np.maximum(total, 1e-12)[:, None], total


def filled(radiance: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Continue a map smoothly into the texels that are not ``seen``: Laplace's equation on the sphere.

    The result stays between the smallest and largest seen values. Far from what is seen it tends to a mean of them.

    Parameters
    ----------
    radiance, seen
        (h, w, 3) and (h, w) bool, at least one texel seen.

    Returns
    -------
    (h, w, 3) float32.
    """
    if seen.all():
        return radiance.astype(np.float32)
    size = seen.size
    a, b, flow = sphere_edges(*seen.shape)
    graph = coo_matrix((flow, (a, b)), shape=(size, size))
    graph = (graph + graph.T).tocsr()
    laplace = (diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsc()
    free, fixed = np.flatnonzero(~seen), np.flatnonzero(seen)
    values = radiance.reshape(-1, 3).astype(np.float64).copy()
    values[free] = spsolve(laplace[free][:, free], -(laplace[free][:, fixed] @ values[fixed]))
    return np.maximum(values, 0).reshape(radiance.shape).astype(np.float32)
