"""Where the cameras stand: the paper's capture (supplement, B.1), sampled in the room.

Several places, 0.5-2.5 m high, turned towards the room's centre, then by up to 60 degrees of yaw
and 45 of pitch, with little roll. Of several such candidates the one that shows most unseen surface
is kept.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from fipt.errors import FiptError
from fipt.io.cameras import Camera
from fipt.settings import Synthesize
from fipt.synthesize.furniture import SIZE
from fipt.synthesize.room import Room

FirstHits = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""(N, 3) origins, (N, 3) unit directions -> (N,) distances in metres, (N,) triangles or -1."""

CLEARANCE = 0.3
"""Nearest surface to a camera, metres."""

HEIGHTS = (0.5, 2.5)
"""Lowest and highest camera, metres; the ceiling's clearance caps the latter."""

CENTER = np.array([SIZE[0] / 2, 1.1, SIZE[2] / 2])
"""What the cameras turn to before they are turned away at random."""

_YAW, _PITCH, _ROLL = 60.0, 45.0, 1.5
_STEEPEST = (-50.0, 20.0)
_CANDIDATES = 12
_SCAN = (32, 24)
_MEDIAN_DEPTH = 1.3
_NEAR_SHARE = 0.03
_COVERED = 0.9


def sample_cameras(room: Room, first_hits: FirstHits, settings: Synthesize) -> list[Camera]:
    """Choose the cameras ``train_000, ..., val_000, ...`` of a room.

    Parameters
    ----------
    room
        The room.
    first_hits
        Traces rays against its mesh.
    settings
        Numbers of views, image size, field of view and seed.

    Returns
    -------
    list of Camera
        A longer list begins with the cameras of a shorter one of the same split.
    """
    surface = surface_points(room)
    weight = np.sqrt(room.mesh.areas)
    seen = np.zeros(len(weight), int)
    train: list[Camera] = []
    for index in range(settings.train_views):
        options = _candidates(f"train_{index:03d}", surface, first_hits, settings)
        # A triangle counts half as much for every view that shows it already.
        gains = [(weight[shown] * 0.5 ** seen[shown]).sum() for _, shown in options]
        camera, shown = options[int(np.argmax(gains))]
        seen[shown] += 1
        train.append(camera)

    covered = np.zeros(len(weight), bool)
    for camera in train:
        covered[scan(camera, first_hits, (96, 72))[1]] = True
    val: list[Camera] = []
    for index in range(settings.val_views):
        options = _candidates(f"val_{index:03d}", surface, first_hits, settings)
        shares = [weight[shown] @ covered[shown] / weight[shown].sum() for _, shown in options]
        enough = np.flatnonzero(np.array(shares) >= _COVERED)
        val.append(options[enough[0] if len(enough) else int(np.argmax(shares))][0])
    return train + val


def surface_points(room: Room, spacing: float = 0.04) -> cKDTree:
    """Return a tree of points on all surfaces, about ``spacing`` metres apart."""
    rng = np.random.default_rng([room.seed, 2])
    areas = room.mesh.areas
    counts = np.ceil(areas / spacing**2).astype(int)
    corners = np.repeat(room.mesh.corners.astype(np.float64), counts, axis=0)
    u, v = rng.random((2, len(corners), 1))
    root = np.sqrt(u)
    points = (1 - root) * corners[:, 0] + root * (1 - v) * corners[:, 1] + root * v * corners[:, 2]
    return cKDTree(points)


def scan(camera: Camera, first_hits: FirstHits, grid: tuple[int, int] = _SCAN) -> tuple[np.ndarray, np.ndarray]:
    """Trace a grid of a view's rays; return (N,) distances and the distinct triangles hit."""
    columns = (np.arange(grid[0]) + 0.5) / grid[0] * camera.width
    rows = (np.arange(grid[1]) + 0.5) / grid[1] * camera.height
    directions = camera.directions(*np.meshgrid(columns, rows)).reshape(-1, 3)
    origins = np.broadcast_to(camera.center.astype(np.float32), directions.shape)
    distance, triangle = first_hits(origins, directions)
    return distance, np.unique(triangle[triangle >= 0])


def _candidates(
    name: str, surface: cKDTree, first_hits: FirstHits, settings: Synthesize
) -> list[tuple[Camera, np.ndarray]]:
    """Draw acceptable cameras of one name, each with the triangles it shows."""
    # The name is the key of the random numbers: no view depends on how many others there are.
    rng = np.random.default_rng([settings.seed, zlib.crc32(name.encode())])
    options = []
    for _ in range(50 * _CANDIDATES):
        camera = _draw(name, rng, surface, settings)
        distance, shown = scan(camera, first_hits)
        staring = np.median(distance) < _MEDIAN_DEPTH
        blocked = (distance < 1.5 * CLEARANCE).mean() > _NEAR_SHARE
        if not staring and not blocked:
            options.append((camera, shown))
        if len(options) == _CANDIDATES:
            break
    if not options:
        raise FiptError(f"no place found for view {name}", "choose another seed or a wider field of view")
    return options


def _draw(name: str, rng: np.random.Generator, surface: cKDTree, settings: Synthesize) -> Camera:
    """Draw one camera in free space."""
    low = np.array([CLEARANCE, HEIGHTS[0], CLEARANCE])
    high = np.array([SIZE[0] - CLEARANCE, min(HEIGHTS[1], SIZE[1] - CLEARANCE), SIZE[2] - CLEARANCE])
    while True:
        center = rng.uniform(low, high)
        if surface.query(center)[0] >= CLEARANCE:
            break
    toward = CENTER - center
    yaw = np.arctan2(-toward[0], -toward[2]) + np.radians(rng.uniform(-_YAW, _YAW))
    level = np.arctan2(toward[1], np.hypot(toward[0], toward[2]))
    while True:
        pitch = level + np.radians(rng.uniform(-_PITCH, _PITCH))
        if _STEEPEST[0] <= np.degrees(pitch) <= _STEEPEST[1]:
            break
        level *= 0.8  # above or below the centre itself the drawn range may miss every allowed pitch
    roll = np.radians(rng.normal(0.0, _ROLL))
    focal = settings.width / 2 / np.tan(np.radians(settings.fov) / 2)
    pose = np.eye(4)
    pose[:3, :3] = _turn(1, yaw) @ _turn(0, pitch) @ _turn(2, roll)
    pose[:3, 3] = center
    return Camera(
        name, name.partition("_")[0], settings.width, settings.height,
        focal, focal, settings.width / 2, settings.height / 2, pose,
    )  # fmt: skip


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) right-handed rotation around a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix
