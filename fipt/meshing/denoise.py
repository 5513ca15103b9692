"""Noise of a mesh: measured, and smoothed away where the surface has no crease."""

import numpy as np

from fipt.meshing.topology import distinct_rows, neighbours, vertex_links
from fipt.scene.mesh import Mesh

_TAUBIN = (0.5, -0.53)
"""Steps of Taubin's filter: a pass band of 0.1 of the highest frequency, without shrinking (SIGGRAPH 1995)."""

_SHARP = np.sqrt(0.5)
"""Cosine below which neighbours meet in a crease: 45 degrees, three deviations of the worst normals of use."""


def normal_deviation(mesh: Mesh) -> np.ndarray:
    """(T,) float32 angle, radians, between each triangle's normal and the mean of itself and its neighbours.

    On flat or evenly bent surface it is near zero; noise of the vertices makes it as large as theirs over the length
    of an edge. Neighbours across a crease do not count.
    """
    # files may give each triangle vertices of its own
    normals, pairs = mesh.normals, neighbours(distinct_rows(mesh.vertices)[1][mesh.triangles])
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > _SHARP]
    mean = normals.copy()
    for one, other in (pairs.T, pairs.T[::-1]):
        for axis in range(3):
            mean[:, axis] += np.bincount(one, normals[other, axis], len(normals))
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    # by the sine: the arc cosine of nearly one is mostly rounding
    return np.arcsin(np.minimum(np.linalg.norm(np.cross(mean, normals), axis=1), 1.0))


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """Value below which half of the weight lies; 0 for none."""
    if len(values) == 0 or weights.sum() <= 0:
        return 0.0
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[min(np.searchsorted(total, 0.5 * total[-1]), len(order) - 1)]])


def taubin(mesh: Mesh, steps: int) -> Mesh:
    """Low-pass filter of the vertices, ``steps`` times there and back."""
    links = vertex_links(mesh)
    count = np.maximum(np.asarray(links.sum(axis=1)), 1.0)
    place = mesh.vertices.astype(np.float32)
    for _ in range(steps):
        for factor in _TAUBIN:
            place = place + np.float32(factor) * (links @ place / count - place)
    return Mesh(place.astype(np.float32), mesh.triangles)


def filtered_normals(mesh: Mesh, sigma: float, steps: int) -> np.ndarray:
    """(T, 3) normals after bilateral filtering over the neighbours across edges.

    Parameters
    ----------
    sigma
        Distance of unit normals that counts as half a crease: neighbours further apart than twice this hardly count.
    steps
        Passes; n passes reach some square root of n triangles far.

    Notes
    -----
    Zheng, Fu, Au and Tai, Bilateral normal filtering for mesh denoising (TVCG 2011), local scheme.
    """
    pairs, area = neighbours(mesh.triangles), mesh.areas
    normals = mesh.normals.astype(np.float64)
    a, b = pairs.T
    for _ in range(steps):
        squared = ((normals[a] - normals[b]) ** 2).sum(axis=1)
        near = np.exp(-squared / (2 * sigma**2))
        total = normals * area[:, None]
        for one, other in ((a, b), (b, a)):
            weight = near * area[other]
            for axis in range(3):
                total[:, axis] += np.bincount(one, weight * normals[other, axis], len(normals))
        normals = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)
    return normals


def fitted_to_normals(mesh: Mesh, normals: np.ndarray, steps: int) -> Mesh:
    """Move the vertices until the triangles have these (T, 3) normals.

    Notes
    -----
    The update of Sun, Rosin, Martin and Langbein, Fast and effective feature-preserving mesh denoising (TVCG 2007).
    """
    corner = mesh.triangles.ravel()
    place = mesh.vertices.astype(np.float64)
    share = 1.0 / np.maximum(np.bincount(corner, minlength=len(place)), 1)
    for _ in range(steps):
        points = place[mesh.triangles]
        away = ((points.mean(axis=1, keepdims=True) - points) * normals[:, None]).sum(axis=2)
        move = (away[:, :, None] * normals[:, None]).reshape(-1, 3)
        for axis in range(3):
            place[:, axis] += share * np.bincount(corner, move[:, axis], len(place))
    return Mesh(place.astype(np.float32), mesh.triangles)
