"""Where light that no view shows may be: the place of unseen surface from which a lamp explains best what is too dark.

A small lamp at c sends to a point p with normal n, at the distance r, light in proportion to cos(n, c - p) / r^2 where
nothing stands between. Of many places on surface that no training view shows, the one is told whose pattern explains
most of the excess of the photographs over the renderings, with one strength by least squares.
"""

import numpy as np

from fipt.scene.mesh import surface_points
from fipt.scene.observed import fully_weighted
from fipt.stages.findings.room import JudgedRoom

_CANDIDATES = 200
_POINTS = 400
_LIFT = 0.01
"""Of a lamp off its surface, share of the room's extent: it hangs below the ceiling."""


def likely_place(room: JudgedRoom) -> np.ndarray | None:
    """(3,) place of the missing lamp, metres; None where no unseen surface sees what is too dark."""
    rng = np.random.default_rng(room.settings.seed)
    points, normals, excess = _excess(room, rng)
    places = _candidates(room, rng)
    if not len(places) or not len(points) or excess.max(initial=0) <= 0:
        return None
    toward = places[:, None] - points[None]
    distance = np.linalg.norm(toward, axis=-1)
    toward = toward / np.maximum(distance[..., None], 1e-9)
    cosine = np.maximum((toward * normals).sum(axis=-1), 0)
    lift = 1e-4 * room.rays.extent
    origins = np.broadcast_to(points + lift * normals, toward.shape).reshape(-1, 3)
    free, _ = room.rays.intersect(origins.astype(np.float32), toward.reshape(-1, 3).astype(np.float32))
    visible = free.reshape(distance.shape) > distance - 2 * lift
    size = _LIFT * room.rays.extent
    pattern = visible * cosine / (distance**2 + size**2)
    norm = np.sqrt(np.maximum((pattern**2).sum(axis=1), 1e-12))
    score = (pattern @ excess) / norm
    best = int(score.argmax())
    return places[best] if score[best] > 0 else None


def _excess(room: JudgedRoom, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, normals (N, 3) and irradiance that is missing there (N,), for some pixels of the retakes."""
    shown = [(retake, fully_weighted(retake.weight) & ~retake.emits) for retake in room.retakes]
    place = np.concatenate([retake.position[use] for retake, use in shown])
    normal = np.concatenate([retake.normal[use] for retake, use in shown])
    excess = np.concatenate([(retake.photo - retake.render).mean(axis=-1)[use] for retake, use in shown])
    chosen = rng.choice(len(place), min(_POINTS, len(place)), replace=False) if len(place) else np.zeros(0, int)
    # a few pixels of mirrors must not decide
    return place[chosen], normal[chosen], np.clip(excess[chosen], 0, np.percentile(excess, 95) if len(excess) else 0)


def _candidates(room: JudgedRoom, rng: np.random.Generator) -> np.ndarray:
    """(C, 3) places just off surface that no training view shows, on both sides of it."""
    mesh = room.mesh
    low, high = mesh.vertices.min(axis=0) - 1.0, mesh.vertices.max(axis=0) + 1.0
    spacing = float(np.sqrt(mesh.areas.sum() / (20 * _CANDIDATES)))
    points, triangle = surface_points(mesh, spacing, low, high, seed=0)
    chosen = rng.permutation(len(points))[: 20 * _CANDIDATES]
    points, triangle = points[chosen], triangle[chosen]
    unseen = ~_seen(room, points)
    points, normal = points[unseen][:_CANDIDATES], mesh.normals[triangle[unseen][:_CANDIDATES]]
    lift = _LIFT * room.rays.extent
    return np.concatenate([points + lift * normal, points - lift * normal])


def _seen(room: JudgedRoom, points: np.ndarray) -> np.ndarray:
    """(N,) bool: some training view shows the point."""
    seen = np.zeros(len(points), bool)
    for view in room.data.views("train"):
        camera = room.data.camera(view)
        image, depth = camera.project(points)
        inside = (depth > 0) & (image > 0).all(axis=1) & (image < [camera.width, camera.height]).all(axis=1)
        asked = np.flatnonzero(inside & ~seen)
        if not len(asked):
            continue
        toward = points[asked] - camera.center
        distance = np.linalg.norm(toward, axis=1)
        met, _ = room.rays.intersect(
            camera.center.astype(np.float32), (toward / np.maximum(distance, 1e-9)[:, None]).astype(np.float32)
        )
        seen[asked[met > 0.999 * distance - 1e-3]] = True
    return seen
