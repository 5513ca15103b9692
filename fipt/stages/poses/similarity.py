"""Similarities (scale, rotation, shift) between sets of points or cameras, some of which may be wrong."""

from itertools import combinations

import numpy as np

_TRIALS = 2000
"""Subsets that are tried where there are more."""


def fit_similarity(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Least-squares similarity between (N, 3) points, N >= 3 (Umeyama 1991).

    Returns
    -------
    (4, 4) target_from_source.
    """
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    a, b = source - mean_source, target - mean_target
    u, d, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * signs) @ vt
    scale = (d * signs).sum() / max((a**2).sum(), 1e-300)
    return matrix(scale, rotation, mean_target - scale * rotation @ mean_source)


def robust_similarity(
    source: np.ndarray, target: np.ndarray, tolerance: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Similarity that most of (N, 3) points agree with, found from triples and fitted to those within tolerance.

    Parameters
    ----------
    source, target
        (N, 3) corresponding points, N >= 3.
    tolerance
        In units of ``target``.
    seed
        Chooses the triples, where not all are tried.

    Returns
    -------
    similarity
        (4, 4) target_from_source.
    good
        (N,) bool, points within the tolerance.
    """
    best, fewest = fit_similarity(source, target), np.inf
    for chosen in _subsets(len(source), 3, seed):
        found = fit_similarity(source[chosen], target[chosen])
        cost = np.minimum(distances(found, source, target), tolerance).sum()
        if cost < fewest:
            best, fewest = found, cost
    good = distances(best, source, target) < tolerance
    if good.sum() >= 3:
        best = fit_similarity(source[good], target[good])
        good = distances(best, source, target) < tolerance
    return best, good


def camera_similarity(source: np.ndarray, target: np.ndarray, tolerance: float, seed: int) -> np.ndarray:
    """Similarity that most cameras agree with; their directions give the rotation, so that two places are enough.

    Parameters
    ----------
    source, target
        (N, 4, 4) world_from_camera, N >= 2.
    tolerance
        Of places, in units of ``target``.
    seed
        Chooses the pairs, where not all are tried.

    Returns
    -------
    (4, 4) target_from_source.
    """
    rotation = common_turn(source, target)
    a, b = source[:, :3, 3] @ rotation.T, target[:, :3, 3]
    best, fewest = matrix(1.0, rotation, b.mean(axis=0) - a.mean(axis=0)), np.inf
    for i, j in _subsets(len(a), 2, seed):
        scale = float(np.linalg.norm(b[j] - b[i]) / max(np.linalg.norm(a[j] - a[i]), 1e-12))
        shift = (b[i] + b[j] - scale * (a[i] + a[j])) / 2
        cost = np.minimum(np.linalg.norm(scale * a + shift - b, axis=1), tolerance).sum()
        if cost < fewest:
            best, fewest = matrix(scale, rotation, shift), cost
    good = distances(best, source[:, :3, 3], b) < tolerance
    if good.sum() >= 3 and not collinear(b[good], tolerance):
        best = fit_similarity(source[good, :3, 3], b[good])
    return best


def common_turn(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that brings the directions of most of (N, 4, 4) cameras to those of others."""
    turns = target[:, :3, :3] @ source[:, :3, :3].transpose(0, 2, 1)
    # The one that is nearest to the others, then the mean of those near it.
    angles = rotation_angles(turns[:, None], turns[None])
    middle = angles[np.median(angles, axis=1).argmin()]
    u, _, vt = np.linalg.svd(turns[middle <= max(2 * np.median(middle), 1e-9)].sum(axis=0))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt


def collinear(points: np.ndarray, tolerance: float) -> bool:
    """Whether (N, 3) points lie on a line, root mean square distance within ``tolerance``."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(np.hypot(*spread[1:]) <= tolerance * np.sqrt(len(points)))


def matrix(scale: float, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(4, 4) similarity of scale, (3, 3) rotation and (3,) shift."""
    similarity = np.eye(4)
    similarity[:3, :3] = scale * rotation
    similarity[:3, 3] = shift
    return similarity


def distances(similarity: np.ndarray, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(N,) distances between moved (N, 3) points and where they should be."""
    return np.linalg.norm(source @ similarity[:3, :3].T + similarity[:3, 3] - target, axis=1)


def rotation_angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...,) angles between (..., 3, 3) rotations, degrees."""
    # From the difference's length, not the trace's arc cosine: that is blind to small angles.
    half = np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8)
    return np.degrees(2 * np.arcsin(np.clip(half, 0, 1)))


def _subsets(count: int, size: int, seed: int) -> list[list[int]]:
    """Return all subsets, or many of them."""
    if count <= (20 if size == 3 else 60):
        return [list(chosen) for chosen in combinations(range(count), size)]
    rng = np.random.default_rng(seed)
    return [rng.choice(count, size, replace=False).tolist() for _ in range(_TRIALS)]
