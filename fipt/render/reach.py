"""Whether light can reach what cameras see: directly, or by way of a few surfaces between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera

_VIEWS = 16
_GRID = (32, 24)
"""Columns and rows of the rays of a camera."""
_PLACES = 4096
"""Places that go on to the next surface."""
_SURFACES = 3
"""Surfaces between a light and what is seen."""
_TRIES = 8
"""Points of a light that each place is asked for."""
_CLOSE = 1e-3
"""Share of the distance by which a ray may end before a point of a light, whose own surface it meets."""


@dataclass(frozen=True)
class LightPoints:
    """Where a light shines from.

    Attributes
    ----------
    points
        (K, 3) points of it, metres.
    axis, cosine
        Of a spot: (3,) unit vector along its axis, and the cosine of the largest angle with it; None: any way.
    """

    points: np.ndarray
    axis: np.ndarray | None = None
    cosine: float = -1.0


def points_on(vertices: np.ndarray, triangles: np.ndarray, count: int = 64) -> np.ndarray:
    """(count, 3) float64 points of a surface, at random by area; with all triangles degenerate, of their corners."""
    rng = np.random.default_rng(0)
    corners = vertices[triangles].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    share = area / area.sum() if area.sum() > 0 else None
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    return np.einsum("nk,nkc->nc", weights, corners[rng.choice(len(corners), count, p=share)])


def unreached(scene: RayScene, cameras: Sequence[Camera], lights: Sequence[LightPoints]) -> list[int]:
    """Numbers of the lights that light nothing the cameras see, and that these do not see either.

    Rays are followed from the cameras over `_SURFACES` surfaces; each place that they meet looks for the lights. Light
    that comes through a gap of a thousandth of what surrounds a place may be missed.
    """
    rng = np.random.default_rng(0)
    places, facing = _seen(scene, cameras)
    dark = [number for number, light in enumerate(lights) if not _lit(scene, light, places, facing, rng)]
    for _ in range(_SURFACES):
        if not dark or not len(places):
            break
        chosen = rng.permutation(len(places))[:_PLACES]
        places, facing = _next(scene, places[chosen], facing[chosen], rng)
        dark = [number for number in dark if not _lit(scene, lights[number], places, facing, rng)]
    return dark


def _seen(scene: RayScene, cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 3) that cameras see and unit normals (N, 3) that face them; the cameras too, which face anywhere."""
    columns, rows = np.meshgrid((np.arange(_GRID[0]) + 0.5) / _GRID[0], (np.arange(_GRID[1]) + 0.5) / _GRID[1])
    chosen = cameras[:: max(1, -(-len(cameras) // _VIEWS))]
    found = [
        _met(
            scene,
            np.tile(c.center, (columns.size, 1)),
            c.directions(columns.ravel() * c.width, rows.ravel() * c.height),
        )
        for c in chosen
    ]
    centers = np.array([camera.center for camera in chosen]).reshape(-1, 3)
    places = np.concatenate([*(own for own, _ in found), centers])
    return places, np.concatenate([*(own for _, own in found), np.zeros_like(centers)])


def _next(
    scene: RayScene, places: np.ndarray, facing: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """What rays from places meet that leave them any way on the side they face."""
    directions = rng.normal(size=places.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions *= np.where((directions * facing).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return _met(scene, places + scene.epsilon * facing, directions)


def _met(scene: RayScene, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places where rays meet the mesh, and unit normals there, turned against the rays."""
    distance, triangle = scene.intersect(origins.astype(np.float32), directions.astype(np.float32))
    met = triangle >= 0
    directions, normals = directions[met], scene.normals[triangle[met]].astype(np.float64)
    normals = np.where((normals * directions).sum(axis=1, keepdims=True) > 0, -normals, normals)
    return origins[met] + distance[met, None] * directions, normals


def _lit(scene: RayScene, light: LightPoints, places: np.ndarray, facing: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether nothing is between some place and some point of the light, on the side that the place faces."""
    for _ in range(_TRIES):
        to = light.points[rng.integers(len(light.points), size=len(places))] - places
        distance = np.linalg.norm(to, axis=1)
        near = distance > 0
        directions = to[near] / distance[near, None]
        asked = (directions * facing[near]).sum(axis=1) >= 0
        if light.axis is not None:
            asked &= -directions @ light.axis >= light.cosine
        if not asked.any():
            continue
        origins = places[near][asked] + scene.epsilon * facing[near][asked]
        free, _ = scene.intersect(origins.astype(np.float32), directions[asked].astype(np.float32))
        if (free >= distance[near][asked] * (1 - _CLOSE) - 2 * scene.epsilon).any():
            return True
    return False
