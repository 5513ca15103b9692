"""A box with painted walls, seen by pinhole cameras: known poses, features everywhere, images in milliseconds."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from fipt.formats.exr import write_exr
from fipt.scene.cameras import Camera

SIZE = np.array([5.0, 2.6, 4.0])
"""Metres; y is up."""

_TEXEL = 0.008
"""Side of a texel of the walls, metres: about a pixel of the images."""


def camera(name: str, place, yaw: float, pitch: float = -5.0, split: str = "train", width: int = 480) -> Camera:
    """A camera at a place, turned by degrees about the vertical (0 looks along -z) and upwards."""
    a, b = np.radians([yaw, pitch])
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn @ tilt, place
    height = width * 3 // 4
    focal = 0.5 * width / np.tan(np.radians(35))
    return Camera(name, split, width, height, focal, focal, width / 2, height / 2, pose)


def ring(
    count: int = 12, first: float = 0.0, step: float = 20.0, prefix: str = "view", width: int = 480
) -> list[Camera]:
    """Cameras on a circle around the room's middle that look across it, ``step`` degrees apart."""
    cameras = []
    for index in range(count):
        yaw = first + step * index
        away = np.array([-np.sin(np.radians(yaw)), 0.1 * (-1) ** index, -np.cos(np.radians(yaw))])
        cameras.append(camera(f"{prefix}_{index:02d}", SIZE * (0.5, 0.55, 0.5) - 0.9 * away, yaw, width=width))
    return cameras


def image(view: Camera, seed: int = 0, blank: bool = False) -> np.ndarray:
    """(H, W, 3) float32 radiance of the room in a view; ``blank``: walls without paint."""
    rows, columns = np.mgrid[: view.height, : view.width] + 0.5
    directions = view.directions(columns, rows).astype(np.float64)
    with np.errstate(divide="ignore"):
        walls = np.where(directions > 0, SIZE - view.center, -view.center) / directions
    wall = walls.argmin(axis=-1)
    points = view.center + directions * walls.min(axis=-1)[..., None]
    side = np.take_along_axis(directions > 0, wall[..., None], -1)[..., 0]
    light = np.zeros(wall.shape, np.float32)
    for axis in range(3):
        for far in (False, True):
            here = (wall == axis) & (side == far)
            u, v = (points[..., other].astype(np.float32) / _TEXEL - 0.5 for other in range(3) if other != axis)
            paint = cv2.remap(_paint(axis, far, seed), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            light[here] = 0.4 if blank else paint[here]
    light *= np.float32(1 - 0.1 * directions[..., 1])  # a little brighter below
    return np.repeat(light[..., None], 3, axis=-1)


_PAINT: dict[tuple[int, bool, int], np.ndarray] = {}


def _paint(axis: int, far: bool, seed: int) -> np.ndarray:
    if (axis, far, seed) not in _PAINT:
        rng = np.random.default_rng([axis, far, seed])
        v, u = (int(np.ceil(SIZE[other] / _TEXEL)) for other in range(2, -1, -1) if other != axis)
        values = np.full((v, u), 0.5, np.float32)
        for size in (2, 5, 12, 30, 80):
            noise = cv2.GaussianBlur(rng.standard_normal((v, u)).astype(np.float32), (0, 0), size / 2)
            values += 0.13 * noise / noise.std()
        _PAINT[axis, far, seed] = np.clip(values, 0.03, 1)
    return _PAINT[axis, far, seed]


def write_views(folder: Path, cameras: list[Camera], **options) -> Path:
    """Write VIEW.exr of every camera, and intrinsics.json; return the latter."""
    for view in cameras:
        write_exr(folder / f"{view.name}.exr", {"": image(view, **options)})
    one = cameras[0]
    keys = {"w": one.width, "h": one.height, "fl_x": one.fx, "fl_y": one.fy, "cx": one.cx, "cy": one.cy}
    (folder / "intrinsics.json").write_text(json.dumps(keys))
    return folder / "intrinsics.json"
