"""Fragments of one emitter: what bars, slats and the noise of a scan tear apart.

Two fragments are one emitter if they are about equally bright, and either touch, or lie in one plane and are so close
that a lattice of such gaps would hide less than half of it: a window behind bars is one window, two windows in a wall
are two.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.scene.mesh import Mesh, surface_points

SIGMA = 3.0
"""Standard errors beyond which radiances differ."""
LEAST_DIFFERENCE = 0.05
"""The same, relative: less is below what shading can tell."""
_TOUCHING = 2.0
"""Widths of a pixel within which two fragments would be one in a picture: one for the pixel, one for the mesh."""
_FLATNESS = 3.0
"""Distances from the planes of two fragments by themselves within which they lie in a common one."""
_GAP = float(np.sqrt(2) - 1)
"""Gap in widths of a fragment with which a square lattice hides half of what is behind it: (1 + gap)^2 = 2."""
_POINTS = 20_000
"""On all fragments, about: gaps are measured between them."""


@dataclass(frozen=True)
class _Planes:
    """The plane of each of K fragments.

    Attributes
    ----------
    center, normal
        (K, 3) metres; unit length.
    flatness, width
        (K,) root mean square distance from the plane; extent of a rectangle of the same moments, the shorter one;
        metres.
    """

    center: np.ndarray
    normal: np.ndarray
    flatness: np.ndarray
    width: np.ndarray


def same_emitters(
    mesh: Mesh,
    triangles: np.ndarray,
    emitter: np.ndarray,
    level: np.ndarray,
    error: np.ndarray,
    pixel: float,
) -> np.ndarray:
    """(2, N) pairs of fragments that are one emitter.

    Parameters
    ----------
    triangles, emitter
        (E,) emitting triangles, and the number of the fragment of each, of K.
    level, error
        (K, 3) radiance of each fragment and its standard error.
    pixel
        Width of a pixel on them, metres.
    """
    count = len(level)
    if count < 2:
        return np.empty((2, 0), np.int64)
    points, owner = _points(mesh, triangles, emitter, pixel)
    planes = _planes(points, owner, count)
    order = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[order], np.arange(count + 1))
    own = [points[order[starts[k] : starts[k + 1]]] for k in range(count)]
    low, high = (np.stack([side(each, axis=0) for each in own]) for side in (np.min, np.max))
    pairs: list[tuple[int, int]] = []
    for a in range(count - 1):  # one by one: scans have thousands, and few are alike
        b = a + 1 + np.flatnonzero(_alike(level, error, a, np.arange(a + 1, count)))
        reach = np.where(_coplanar(planes, a, b, pixel), _GAP * np.minimum(planes.width[a], planes.width[b]), 0)
        reach = np.maximum(reach, _TOUCHING * pixel)
        close = np.linalg.norm(np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0), axis=1) <= reach
        if close.any():
            tree = cKDTree(own[a])
            for k, within in zip(b[close].tolist(), reach[close], strict=True):
                if tree.query(own[k], distance_upper_bound=within)[0].min() <= within:
                    pairs.append((a, k))
    return np.array(pairs, np.int64).reshape(-1, 2).T


def _points(mesh: Mesh, triangles: np.ndarray, emitter: np.ndarray, pixel: float) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) points on the fragments, corners of triangles among them, and the fragment (N,) of each."""
    own = Mesh(mesh.vertices, mesh.triangles[triangles])
    low, high = mesh.vertices.min(axis=0) - 1, mesh.vertices.max(axis=0) + 1
    points, index = surface_points(own, max(pixel, float(np.sqrt(own.areas.sum() / _POINTS))), low, high, seed=0)
    corners = own.corners.reshape(-1, 3)
    return np.concatenate([points, corners]).astype(np.float64), np.concatenate([emitter[index], np.repeat(emitter, 3)])


def _planes(points: np.ndarray, owner: np.ndarray, count: int) -> _Planes:
    number = np.bincount(owner, minlength=count)[:, None]
    center = np.stack([np.bincount(owner, column, count) for column in points.T], axis=1) / number
    offset = points - center[owner]
    moments = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(3):
            moments[:, i, j] = np.bincount(owner, offset[:, i] * offset[:, j], count) / number[:, 0]
    values, vectors = np.linalg.eigh(moments)
    values = np.maximum(values, 0)
    return _Planes(center, vectors[..., 0], np.sqrt(values[:, 0]), np.sqrt(12 * values[:, 1]))


def _alike(level: np.ndarray, error: np.ndarray, a: int, b: np.ndarray) -> np.ndarray:
    """(N,) bool: the radiances of fragment ``a`` and of fragments ``b`` do not differ."""
    allowed = SIGMA * np.hypot(error[a], error[b])
    allowed = np.maximum(allowed, LEAST_DIFFERENCE * np.maximum(level[a], level[b]).mean(axis=1, keepdims=True))
    return np.all(np.abs(level[a] - level[b]) <= allowed, axis=1)


def _coplanar(planes: _Planes, a: int, b: np.ndarray, pixel: float) -> np.ndarray:
    """(N,) bool: ``a`` and each of ``b`` lie in the other's plane, as well as in their own.

    Half a pixel shows in no picture.
    """
    between = planes.center[b] - planes.center[a]
    off = np.maximum(np.abs((between * planes.normal[a]).sum(axis=1)), np.abs((between * planes.normal[b]).sum(axis=1)))
    return off <= np.maximum(_FLATNESS * np.hypot(planes.flatness[a], planes.flatness[b]), 0.5 * pixel)
