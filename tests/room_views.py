"""A box room drawn by plain NumPy: cameras, points and images whose truth is known, for the tests of poses.

The room is 5.0 x 2.7 x 4.0 m, y up, floor at y = 0, its lower corner the origin. Every image is the mean over 2 x 2
rays a pixel that meet the walls, where rectangles are painted, and boards: flat images anywhere in the room.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from fipt.formats.exr import write_exr
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.mesh import Mesh, write_ply
from fipt.stages.poses.model import Reconstruction, Tracks, transformed
from tests import scenes

SIZE = np.array([5.0, 2.7, 4.0])
_SUB = (np.arange(2) + 0.5) / 2


@dataclass(frozen=True)
class Board:
    """A flat image: corner, sides u (along its columns) and v (down its rows) in metres, (h, w) values in [0, 1]."""

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    image: np.ndarray


def charuco(corner, u, v, columns=4, rows=3, square=0.08, name="DICT_5X5_100") -> Board:
    """A ChArUco board with inner corners ``columns`` x ``rows`` whose top left corner and directions are given."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), square, 0.75 * square, markers)
    image = board.generateImage((40 * (columns + 1), 40 * (rows + 1)))
    u, v = (np.asarray(side, float) / np.linalg.norm(side) for side in (u, v))
    return Board(np.asarray(corner, float), u * square * (columns + 1), v * square * (rows + 1), image / 255.0)


def tag(corner, u, v, number=3, side=0.2, name="DICT_APRILTAG_36h11") -> Board:
    """An AprilTag with a white border of a quarter of its ``side``."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    image = np.pad(cv2.aruco.generateImageMarker(markers, number, 160), 40, constant_values=255)
    u, v = (np.asarray(side_, float) / np.linalg.norm(side_) for side_ in (u, v))
    corner = np.asarray(corner, float) - 0.25 * side * (u + v)
    return Board(corner, u * 1.5 * side, v * 1.5 * side, image / 255.0)


def look_at(name: str, center, target, size=(480, 360), fov=70.0, roll=0.0) -> Camera:
    """A camera at ``center`` that looks at ``target``; ``roll`` in degrees."""
    center = np.asarray(center, float)
    back = center - np.asarray(target, float)
    back /= np.linalg.norm(back)
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    pose = np.eye(4)
    pose[:3] = np.stack([c * right + s * up, c * up - s * right, back, center], axis=1)
    focal = size[0] / 2 / np.tan(np.radians(fov) / 2)
    return Camera(name, "train", *size, focal, focal, size[0] / 2, size[1] / 2, pose)


def cameras(count=8, height=1.5, seed=0, target=(2.5, 0.5, 2.0), size=(480, 360)) -> list[Camera]:
    """Cameras on a ring in the room that look at a place in its middle, with a roll of about a degree."""
    rng = np.random.default_rng(seed)
    found = []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        center = [2.5 + 1.6 * np.cos(angle), height + 0.2 * rng.normal() * (height == 1.5), 2.0 + 1.3 * np.sin(angle)]
        found.append(look_at(f"v{index}", center, target + 0.2 * rng.normal(size=3), size, roll=rng.normal()))
    return found


def walled() -> list[Board]:
    """Boards on the floor and on all walls: structure wherever a camera looks."""
    width, _, depth = SIZE
    return [
        charuco((1.2, 0.001, 1.0), (1, 0, 0.3), (-0.3, 0, 1), square=0.4),
        charuco((1.0, 2.2, 0.001), (1, 0, 0), (0, -1, 0), square=0.3),
        charuco((0.001, 2.2, 2.6), (0, 0, -1), (0, -1, 0), square=0.3),
        charuco((width - 0.001, 2.2, 1.0), (0, 0, 1), (0, -1, 0), square=0.3),
        charuco((3.0, 2.2, depth - 0.001), (-1, 0, 0), (0, -1, 0), square=0.3),
    ]


def write_dataset(folder: Path, views: Sequence[tuple[Camera, np.ndarray]], mesh: Mesh | None = None) -> Path:
    """Write views with their images as a dataset; the mesh is the box of the room where none is given."""
    for camera, image in views:
        write_exr(folder / "images" / f"{camera.name}.exr", {"": image})
    write_transforms(folder / "transforms.json", [camera for camera, _ in views])
    write_views(folder / "views.json", [camera.name for camera, _ in views])
    write_ply(folder / "mesh.ply", scenes.box((0, 0, 0), SIZE) if mesh is None else mesh)
    return folder


def surface_points(count=3000, noise=0.004, seed=1) -> np.ndarray:
    """(count, 3) points on floor, walls and a table of 1.2 x 0.8 m, as a reconstruction finds them."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (count, 3)) * SIZE
    kind = rng.choice(6, count, p=[0.2, 0.15, 0.15, 0.15, 0.15, 0.2])
    points[kind == 0, 1] = 0.0
    for number, (axis, value) in enumerate([(0, 0.0), (0, SIZE[0]), (2, 0.0), (2, SIZE[2])], 1):
        points[kind == number, axis] = value
    table = kind == 5
    points[table] = np.array([2.0, 0.75, 1.6]) + points[table] / SIZE * [1.2, 0.0, 0.8]
    return points + noise * rng.normal(size=points.shape)


def draw(camera: Camera, boards=(), exposure=1.0) -> np.ndarray:
    """(H, W, 3) float32 radiance of a view."""
    rows, columns = np.mgrid[: camera.height, : camera.width].astype(float)
    total = np.zeros(rows.shape)
    for dy in _SUB:
        for dx in _SUB:
            rays = camera.directions(columns + dx, rows + dy).astype(float)
            total += _shade(camera.center, rays, boards)
    return np.float32(exposure * np.repeat(total[..., None] / len(_SUB) ** 2, 3, axis=2))


def _shade(center: np.ndarray, rays: np.ndarray, boards) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(rays > 0, (SIZE - center) / rays, -center / rays)
    axis = walls.argmin(axis=-1)
    nearest = walls.min(axis=-1)
    point = center + nearest[..., None] * rays
    side = np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0
    # Plan coordinates of each wall, and two painted rectangles on it, whose sides are level and upright.
    first = np.where(axis == 0, point[..., 2], point[..., 0])
    second = np.where(axis == 1, point[..., 2], point[..., 1])
    value = 0.35 + 0.1 * axis + 0.07 * side
    for low, high, paint in (((0.5, 0.6), (1.7, 1.9), 0.15), ((2.3, 0.9), (3.4, 1.6), 0.8)):
        inside = (first > low[0]) & (first < high[0]) & (second > low[1]) & (second < high[1])
        value = np.where(inside, paint, value)
    for board in boards:
        normal = np.cross(board.u, board.v)
        with np.errstate(divide="ignore"):
            distance = ((board.corner - center) @ normal) / (rays @ normal)
        place = center + distance[..., None] * rays - board.corner
        s, t = place @ board.u / (board.u @ board.u), place @ board.v / (board.v @ board.v)
        hit = (distance > 0) & (distance < nearest + 1e-6) & (s >= 0) & (s < 1) & (t >= 0) & (t < 1)
        height, width = board.image.shape
        texel = board.image[
            np.clip(t * height, 0, height - 1).astype(int), np.clip(s * width, 0, width - 1).astype(int)
        ]
        value, nearest = np.where(hit, 0.05 + 0.8 * texel, value), np.where(hit, distance, nearest)
    return value


def reconstruction(views: list[Camera], points: np.ndarray, seed=5) -> tuple[Reconstruction, np.ndarray]:
    """Cameras and points in a frame of their own, and metres_from_reconstruction, the truth."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    similarity = np.eye(4)
    similarity[:3, :3] = rng.uniform(0.2, 0.6) * Rotation.random(random_state=seed).as_matrix()
    similarity[:3, 3] = rng.normal(size=3)
    none = Tracks(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2), np.float32))
    true = Reconstruction(tuple(views), points, np.full(len(points), 0.5, np.float32), none)
    return transformed(true, similarity), np.linalg.inv(similarity)
