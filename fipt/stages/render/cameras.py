"""A setup's own cameras: placed freely, or along a smooth way through keyframes."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from fipt.errors import FiptError
from fipt.formats.files import check_name
from fipt.scene.cameras import Camera, up_axis
from fipt.scene.dataset import Dataset
from fipt.scene.setup import CameraLens, CameraPath, Keyframe, OwnCameras, check_keyframes

_SAMPLES = 256
"""Points between two keyframes by which the length of the way is measured."""
_STILL = 1e-6
"""Metres, or radians: a shorter way is none."""
_ON_THE_SPOT = 0.25
"""Metres a radian: what moves less while it turns only turns. Poses estimated at one place are never quite the same."""


def own_cameras(own: OwnCameras, data: Dataset) -> list[Camera]:
    """Cameras of a setup in the order of their names.

    Raises
    ------
    FiptError
        If a name cannot become a file, a keyframe names no view of the dataset, or a camera has no direction.
    """
    if not data.cameras:
        raise FiptError(f"{data.root} has no accepted view", "see its views.json for the reasons")
    if own.path is not None:
        poses, lens = poses_along(own.path, data), own.path
        return [_camera(name, lens, pose, data.cameras[0]) for name, pose in zip(own.names, poses, strict=True)]
    return [
        _camera(
            check_name(name, "camera"),
            lens,
            pose_towards(lens.position, lens.target, up_of(lens, data)),
            data.cameras[0],
        )
        for name, lens in (own.look_at or {}).items()
    ]


def chosen_cameras(own: OwnCameras, data: Dataset, names: Sequence[str]) -> list[Camera]:
    """Return some of a setup's cameras; all where no names are given."""
    known = {camera.name: camera for camera in own_cameras(own, data)}
    for name in names:
        if name not in known:
            raise FiptError(f"the setup has no camera {name}", f"its cameras: {', '.join(list(known)[:8])}")
    return [known[name] for name in names or known]


def up_of(lens: CameraLens, data: Dataset) -> np.ndarray:
    """(3,) unit vector that points up: as stated, else the world axis nearest to the mean of the views' own."""
    if lens.up is not None:
        return np.array(lens.up) / np.linalg.norm(lens.up)
    return up_axis(data.cameras)


def pose_towards(position: Sequence[float], target: Sequence[float], up: np.ndarray) -> np.ndarray:
    """(4, 4) world from a camera that looks from ``position`` to ``target``, with ``up`` to the upper edge.

    Straight up and down, where ``up`` defines no edge, a world axis does.
    """
    forward = np.subtract(target, position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-4:
        right = np.cross(forward, np.eye(3)[int(np.abs(forward).argmin())])
    right /= np.linalg.norm(right)
    return _pose(np.asarray(position, np.float64), forward, right)


def poses_along(path: CameraPath, data: Dataset) -> list[np.ndarray]:
    """(4, 4) world from camera of every frame.

    Keyframes are places and three angles: heading, pitch and roll about ``up``, so that a level camera stays level.
    Between them runs a cubic curve whose slopes are those of the centripetal Catmull-Rom spline. Where the place (or
    the direction) of two neighbours is the same, it stays the same between them.
    """
    for key in path.keyframes:
        if key.view in data.rejected:
            raise FiptError(
                f"a camera path goes through view {key.view}, which was rejected: {data.rejected[key.view]}",
                "choose another view, or give position and target",
            )
    check_keyframes(path, [camera.name for camera in data.cameras])
    up = up_of(path, data)
    poses = [_keyframe_pose(key, data, up) for key in path.keyframes]
    axes = _axes(up)
    curve = _curve(np.array([_coordinates(pose, axes) for pose in poses]), path.loop)
    return [_from_coordinates(values, axes) for values in curve(_moments(path, curve))]


def _keyframe_pose(key: Keyframe, data: Dataset, up: np.ndarray) -> np.ndarray:
    """(4, 4) world from camera of a keyframe: that of a view, or from a place to another."""
    if key.view is not None:
        return data.camera(key.view).world_from_camera
    assert key.position is not None  # a keyframe without a view has both
    assert key.target is not None
    return pose_towards(key.position, key.target, up)


def _curve(keys: np.ndarray, loop: bool) -> CubicHermiteSpline:
    """Smooth curve through (K, 6) keyframes and, of a loop, back to the first: places and angles."""
    ends = (keys[-1:], keys[:2]) if loop else (keys[:0], keys[:0])
    keys = np.concatenate([ends[0], keys, ends[1]])
    keys[:, 3:] = np.unwrap(keys[:, 3:], axis=0)
    if not loop:  # straight on before the first and after the last
        keys = np.concatenate([2 * keys[:1] - keys[1:2], keys, 2 * keys[-1:] - keys[-2:-1]])
    steps = np.diff(keys, axis=0)
    lengths = np.stack([np.linalg.norm(steps[:, :3], axis=1), np.linalg.norm(steps[:, 3:], axis=1)])
    if lengths[:, 1:-1].max() < _STILL:
        raise FiptError("the keyframes of a path are all the same", "give places apart, or other directions")
    gaps = np.maximum(np.sqrt(lengths.sum(axis=0)), 1e-3)[:, None]  # a radian counts as a metre
    before, after = gaps[:-1], gaps[1:]
    slopes = steps[:-1] / before - (steps[:-1] + steps[1:]) / (before + after) + steps[1:] / after
    for columns, length in zip((slice(0, 3), slice(3, 6)), lengths, strict=True):
        still = (length[:-1] < _STILL) | (length[1:] < _STILL)
        slopes[still, columns] = 0
    knots = np.concatenate([[0.0], np.cumsum(gaps[1:-1, 0])])
    return CubicHermiteSpline(knots, keys[1:-1], slopes)


def _moments(path: CameraPath, curve: CubicHermiteSpline) -> np.ndarray:
    """(frames,) parameters of the curve at which frames are taken.

    Frames are equally far apart along the way; where the camera turns about on the spot, a radian counts as a metre.
    """
    segments = len(curve.x) - 1
    shares = np.linspace(0, 1, _SAMPLES + 1)
    fine = curve.x[:-1, None] + np.diff(curve.x)[:, None] * shares  # (segments, samples)
    steps = np.diff(curve(fine), axis=1)
    moved, turned = np.linalg.norm(steps[..., :3], axis=2), np.linalg.norm(steps[..., 3:], axis=2)
    turns = moved.sum(axis=1, keepdims=True) <= _ON_THE_SPOT * turned.sum(axis=1, keepdims=True)
    lengths = np.where(turns, turned, moved)
    way = np.concatenate([[0.0], np.cumsum(lengths.ravel())])
    parameters = np.concatenate([fine[:, :-1].ravel(), curve.x[-1:]])
    share = np.linspace(0, 1, path.frames, endpoint=not path.loop)
    if path.timing == "speed":
        wanted = share * way[-1]
    else:
        wanted = PchipInterpolator(np.arange(segments + 1), way[::_SAMPLES])(share * segments)
    return np.interp(wanted, way, parameters)


def _axes(up: np.ndarray) -> np.ndarray:
    """(3, 3) rows: two level directions and up, a right-handed system."""
    first = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])


def _coordinates(pose: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(6,) place, heading, pitch and roll of a camera, metres and radians."""
    right, above, back = (axes @ pose[:3, :3]).T
    forward = -back
    pitch = np.arcsin(np.clip(forward[2], -1, 1))
    if np.hypot(*forward[:2]) < 1e-3:  # straight up or down: the image's upper edge gives the heading
        heading = -np.sign(forward[2]) * above
        return np.array([*pose[:3, 3], np.arctan2(heading[1], heading[0]), pitch, 0.0])
    yaw = np.arctan2(forward[1], forward[0])
    level = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    return np.array([*pose[:3, 3], yaw, pitch, np.arctan2(right @ np.cross(level, forward), right @ level)])


def _from_coordinates(values: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Invert `_coordinates`: (4, 4) world from camera."""
    yaw, pitch, roll = values[3:]
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    level = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    right = np.cos(roll) * level + np.sin(roll) * np.cross(level, forward)
    return _pose(values[:3], forward @ axes, right @ axes)


def _pose(position: np.ndarray, forward: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(4, 4) world from camera, OpenGL axes, of unit vectors at right angles."""
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(right, forward), -forward, position], axis=1)
    return pose


def _camera(name: str, lens: CameraLens, pose: np.ndarray, first: Camera) -> Camera:
    """A camera with square pixels and its axis in the middle; what ``lens`` leaves open is as in the first view."""
    width, height = lens.width or first.width, lens.height or first.height
    if lens.fov is not None:
        focal = width / (2 * np.tan(np.radians(lens.fov) / 2))
    elif lens.vertical_fov is not None:
        focal = height / (2 * np.tan(np.radians(lens.vertical_fov) / 2))
    else:
        focal = first.fx * width / first.width
    return Camera(name, "val", width, height, float(focal), float(focal), width / 2, height / 2, pose)
