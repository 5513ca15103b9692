"""Which way is up: by a board, by the floor, by how people hold cameras; and where the floor is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from fipt.scene.cameras import Camera
from fipt.stages.poses.model import Reconstruction
from fipt.stages.poses.room_boards import PlacedTarget
from fipt.stages.poses.settings import SceneBoard

_STEEPEST = 25.0
"""Degrees between the floor's normal and the cameras' mean up, at most."""

_FLOOR_TRIES = 2000

_FLOOR_SAMPLE = 5000

_MORE = 3.0
"""Points on the floor over those that any level slice of the walls would hold, at least."""

_TURNED = {3: 180.0, 6: 90.0, 8: -90.0}
"""EXIF orientation -> degrees by which the camera was turned; the others are upright, or mirrored, as none is."""

_FLAT = 0.004
"""Half the floor's thickness over the extent of the points."""


@dataclass(frozen=True)
class Plane:
    """The floor: n . x = offset with n upwards, (3,) unit vector.

    Attributes
    ----------
    normal, offset
        In units of the reconstruction.
    points
        Points on it.
    deviation
        Root mean square distance of these.
    """

    normal: np.ndarray
    offset: float
    points: int
    deviation: float


def cameras_up(cameras: Sequence[Camera], orientation: Mapping[str, int]) -> tuple[np.ndarray, float]:
    """Up as photographers hold their cameras: nearly level, so that no camera's x axis points up or down.

    Parameters
    ----------
    cameras
        In the sensor's frame.
    orientation
        View -> EXIF orientation; of others it is 1. The axes of a camera that was held upright are turned.

    Returns
    -------
    up
        (3,) unit vector.
    spread
        Median angle between the cameras' x axes and the level plane, degrees.
    """
    turns = [_turn(orientation.get(camera.name, 1)) for camera in cameras]
    axes = np.array([camera.world_from_camera[:3, :3] @ turn for camera, turn in zip(cameras, turns, strict=True)])
    mean, x = axes[:, :, 1].mean(axis=0), axes[:, :, 0]
    up = mean / max(np.linalg.norm(mean), 1e-12)
    # What is across two cameras' x axes is across those of most, if those two are not the odd ones.
    pairs = np.array(list(combinations(range(len(x)), 2))[:: max(len(x) ** 2 // 4000, 1)], int).reshape(-1, 2)
    across = np.cross(x[pairs[:, 0]], x[pairs[:, 1]])
    length = np.linalg.norm(across, axis=1)
    across = across[length > 0.2] / length[length > 0.2, None]
    if len(across):
        best = across[np.argmin(np.median(np.abs(across @ x.T), axis=1))]
        level = x[np.abs(x @ best) < 0.2]
        values, vectors = np.linalg.eigh(level.T @ level / len(level))
        # Where cameras look one way, their x axes are one line, and any direction across it would do.
        if values[1] > 0.02:
            up = vectors[:, 0] * np.sign(vectors[:, 0] @ mean)
    return up, float(np.median(np.degrees(np.arcsin(np.clip(np.abs(x @ up), 0, 1)))))


def _turn(orientation: int) -> np.ndarray:
    """(3, 3) turn about a camera's z that makes the axes of its sensor those of the photograph as it is shown."""
    angle = np.radians(_TURNED.get(orientation, 0))
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def find_floor(points: np.ndarray, centers: np.ndarray, up: np.ndarray, seed: int) -> Plane | None:
    """Find the floor by random triples of (P, 3) points below all cameras; None if no plane holds enough of them.

    The floor is the lowest level plane with enough points, and little lies below it: a table may hold more points.
    """
    height, lowest = points @ up, (centers @ up).min()
    if len(points) < 20:
        return None
    extent = np.linalg.norm(np.ptp(np.percentile(points, [2, 98], axis=0), axis=0))
    low = points[height < lowest]
    if len(low) < 20:
        return None
    tolerance = float(_FLAT * extent)
    rng = np.random.default_rng(seed)
    triples = low[rng.integers(len(low), size=(_FLOOR_TRIES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    # Thin triples have no certain normal.
    wide = length > (0.05 * extent) ** 2
    normals, corner = normals[wide] / length[wide, None], triples[wide, 0]
    normals *= np.sign(normals @ up)[:, None]
    level = normals @ up > np.cos(np.radians(_STEEPEST))
    normals, offsets = normals[level], (normals[level] * corner[level]).sum(axis=1)
    sample = low[rng.permutation(len(low))[:_FLOOR_SAMPLE]]
    best = _lowest(sample, normals, offsets, (centers.mean(axis=0), up), tolerance)
    if best is None:
        return None
    normal, offset = normals[best], offsets[best]
    for reach in (tolerance, 0.6 * tolerance, 0.6 * tolerance):
        near = low[np.abs(low @ normal - offset) < reach]
        if len(near) < 10:
            return None
        _, _, axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)
        normal = axes[2] * np.sign(axes[2] @ up)
        offset = float(normal @ near.mean(axis=0))
    return Plane(normal, offset, len(near), float(np.sqrt(np.mean((near @ normal - offset) ** 2))))


def _lowest(
    points: np.ndarray, normals: np.ndarray, offsets: np.ndarray, above: tuple[np.ndarray, np.ndarray], tolerance: float
) -> int | None:
    """Number of the plane that lies lowest below a place, of those that hold enough points and have little below them.

    Planes are taken by how many points they hold that no earlier one has: one that cuts the floor at an angle holds
    but a strip of it.

    Parameters
    ----------
    points
        (P, 3), in units of the reconstruction.
    normals, offsets
        (N, 3) unit vectors and (N,) of the planes n . x = offset.
    above
        The place (3,), and which way is up (3,), a unit vector.
    tolerance
        Half the thickness of a plane, in the same units.
    """
    if not len(normals):
        return None
    away = (normals @ points.T - offsets[:, None]).astype(np.float32)
    on, below = np.abs(away) < tolerance, (away < -2 * tolerance).sum(axis=1)
    place, up = above
    slices = max(int(np.ptp(points @ up) / (2 * tolerance)), 1)
    by_chance = np.median(np.histogram(points @ up, slices)[0])
    enough = max(15, _MORE * by_chance, 0.1 * on.sum(axis=1).max())
    drop = (normals @ place - offsets) / (normals @ up)
    found, free = [], np.ones(len(points), bool)
    while True:
        held = on[:, free].sum(axis=1)
        best = int(held.argmax())
        if held[best] < enough:
            return max(found, key=lambda index: drop[index], default=None)
        free &= np.abs(away[best]) > 2 * tolerance
        if below[best] < 0.5 * on[best].sum():
            found.append(best)


def board_up(
    placed: Sequence[PlacedTarget], board: SceneBoard | None, centers: np.ndarray, own_up: np.ndarray
) -> np.ndarray | None:
    """Up by boards on the floor or on a wall: the mean over boards, weighted by the corners that show it."""
    if not placed or board is None or board.place == "anywhere":
        return None
    found = []
    for target in placed:
        if board.place == "floor":
            normal = target.rotation[:, 2]
            found.append(normal * np.sign((centers.mean(axis=0) - target.shift) @ normal))
        else:
            sides = np.concatenate([target.rotation[:, :2].T, -target.rotation[:, :2].T])
            found.append(sides[np.argmax(sides @ own_up)])
    mean = np.sum([up / max(target.pixels, 0.05) for up, target in zip(found, placed, strict=True)], axis=0)
    return mean / np.linalg.norm(mean)


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two directions, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def ground_height(
    floor: Plane | None,
    placed: Sequence[PlacedTarget],
    board: SceneBoard | None,
    reconstruction: Reconstruction,
    up: np.ndarray,
) -> tuple[float, dict[str, Any]]:
    """Height of the floor along ``up`` under the middle of the cameras, in units of the reconstruction."""
    if floor is not None:
        middle = reconstruction.centers.mean(axis=0)
        # Straight down from the middle of the cameras to the plane.
        drop = (floor.normal @ middle - floor.offset) / (floor.normal @ up)
        return float(middle @ up - drop), {"source": "plane", "points": floor.points}
    if placed and board is not None and board.place == "floor":
        return float(np.median(np.concatenate([target.corners for target in placed]) @ up)), {"source": "board"}
    if len(reconstruction.points):
        return float(np.percentile(reconstruction.points @ up, 1)), {"source": "lowest points"}
    return float((reconstruction.centers @ up).min()), {"source": "lowest camera"}
