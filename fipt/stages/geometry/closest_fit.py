"""Surfaces brought onto each other by open3d, for a process of its own: this module imports little."""

from typing import Any

import numpy as np

from fipt.stages.geometry.library import import_open3d

_REACHES = (8.0, 2.0, 1.0)
"""Distances at which points are paired, one after the other, in that at which they fit."""
_STEPS = 30
_HOPEFUL = 0.9
"""Share of the best place's points from which on a place is refined."""


def closest_fit(
    points: np.ndarray, surface: np.ndarray, normals: np.ndarray, starts: np.ndarray, reach: float
) -> dict[str, np.ndarray]:
    """Bring points to a surface, from several starts, by the distance to its tangent planes (Chen and Medioni 1992).

    Parameters
    ----------
    points
        (N, 3) float64, metres.
    surface, normals
        (M, 3) float64 points of the surface and their unit normals.
    starts
        (K, 4, 4) float64 surface_from_points at first.
    reach
        Distance within which a point fits, metres.

    Returns
    -------
    dict
        ``found`` (K, 4, 4) float64 surface_from_points, and ``share`` (K,) float64 of the points that fit.
    """
    o3d = import_open3d()
    tools = o3d.pipelines.registration
    moved, still = _cloud(o3d, points), _cloud(o3d, surface)
    still.normals = o3d.utility.Vector3dVector(normals)
    found, share = np.array(starts, np.float64), np.ones(len(starts))
    for wide in _REACHES:
        for number in np.flatnonzero(share > _HOPEFUL * share.max()):
            method = tools.TransformationEstimationPointToPlane(tools.TukeyLoss(k=wide * reach))
            steps = tools.ICPConvergenceCriteria(max_iteration=_STEPS)
            result = tools.registration_icp(moved, still, wide * reach, found[number], method, steps)
            found[number], share[number] = result.transformation, result.fitness
    return {"found": found, "share": share}


def _cloud(o3d: Any, points: np.ndarray) -> Any:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.ascontiguousarray(points, np.float64)))
