"""Cameras of a dataset, and transforms.json, the file they live in."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fipt.conventions import FARTHEST
from fipt.errors import FiptError
from fipt.formats.files import check_name, existing_file, write_text
from fipt.formats.text import MALFORMED

_IMAGE_AXES = np.diag([1.0, -1.0, -1.0])
"""Image axes from a camera's, which are OpenGL's."""
_FARTHEST = 10
"""Sizes of the image that the principal point may lie away: a crop or a shifted lens has it outside, by a few."""
_FOCAL = (0.01, 1e4)
"""Focal length over width of an image: 178 degrees across; a piece of a photograph by a long lens."""
_LONGEST = 4
"""Times that a pixel may be as long as wide: anamorphic lenses double it."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    name
        View name, unique in its dataset.
    split
        ``train`` or ``val``.
    width, height
        Image size in pixels.
    fx, fy, cx, cy
        Focal lengths and principal point in pixels; the centre of the top left pixel is (0.5, 0.5).
    world_from_camera
        (4, 4) float64 rigid transform, OpenGL axes (x right, y up, looking along -z), metres.
    """

    name: str
    split: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_from_camera: np.ndarray

    @property
    def is_shifted(self) -> bool:
        """Whether its principal point lies outside the image: a crop, a lens that is shifted, or wrong intrinsics."""
        return not (0 <= self.cx <= self.width and 0 <= self.cy <= self.height)

    @property
    def center(self) -> np.ndarray:
        """(3,) float64 position in world space, metres."""
        return self.world_from_camera[:3, 3]

    @property
    def extrinsics(self) -> np.ndarray:
        """(3, 4) float64 image axes (x right, y down, z forward) from world axes, metres."""
        turn = _IMAGE_AXES @ np.asarray(self.world_from_camera[:3, :3], np.float64).T
        return np.column_stack([turn, -turn @ self.center])

    @property
    def intrinsics(self) -> np.ndarray:
        """(3, 3) float64 pixels, counted by their centres, from image axes: the first pixel is (0, 0)."""
        return np.array([[self.fx, 0.0, self.cx - 0.5], [0.0, self.fy, self.cy - 0.5], [0.0, 0.0, 1.0]])

    def reduced(self, block: int) -> "Camera":
        """Return the camera whose pixels are blocks of ``block`` x ``block`` of this one's (`fipt.scene.blocks`)."""
        scaled = {name: getattr(self, name) / block for name in ("fx", "fy", "cx", "cy")}
        return replace(self, width=self.width // block, height=self.height // block, **scaled)

    def resized(self, width: int, height: int) -> "Camera":
        """Return the camera with images of another size."""
        x, y = width / self.width, height / self.height
        scaled = {"fx": self.fx * x, "cx": self.cx * x, "fy": self.fy * y, "cy": self.cy * y}
        return replace(self, width=width, height=height, **scaled)

    def directions(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return unit world directions through image points.

        Parameters
        ----------
        columns, rows
            (...,) image coordinates in pixels; pixel (i, j) spans [j, j + 1) x [i, i + 1).

        Returns
        -------
        (..., 3) float32 directions pointing away from the camera.
        """
        d = self._local_rays(columns, rows)
        d /= np.linalg.norm(d, axis=-1, keepdims=True)
        return (d @ self.world_from_camera[:3, :3].T).astype(np.float32)

    def rays(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(..., 3) float64 world vectors from the centre to depth 1 along the view axis, through image points."""
        return self._local_rays(columns, rows) @ self.world_from_camera[:3, :3].T

    def _local_rays(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        x = (np.asarray(columns, np.float64) - self.cx) / self.fx
        y = -(np.asarray(rows, np.float64) - self.cy) / self.fy
        return np.stack([x, y, -np.ones_like(x)], axis=-1)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project (N, 3) world points; return (N, 2) image coordinates and (N,) depth along the view axis, metres."""
        rotation = self.world_from_camera[:3, :3]
        local = (np.asarray(points, np.float64) - self.center) @ rotation
        depth = -local[:, 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        image = np.stack([self.cx + self.fx * local[:, 0] / safe, self.cy - self.fy * local[:, 1] / safe], axis=1)
        return image, depth


def write_transforms(
    path: str | Path,
    cameras: list[Camera],
    folder: str = "images/",
    origin: np.ndarray | None = None,
    radiance_scale: float = 1.0,
) -> None:
    """Write cameras as transforms.json (nerfstudio convention, intrinsics and split per frame).

    ``folder`` of the images is relative to that of the file, with a slash at its end. ``origin`` (3,) is what was
    subtracted from the positions of the source, metres; it is written where it is not zero. ``radiance_scale`` is the
    factor from the source's radiance to that of the images; it is written where it is not 1.
    """
    frames = [
        {
            "file_path": f"{folder}{camera.name}.exr",
            "split": camera.split,
            "w": camera.width,
            "h": camera.height,
            "fl_x": camera.fx,
            "fl_y": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "transform_matrix": np.asarray(camera.world_from_camera, np.float64).tolist(),
        }
        for camera in cameras
    ]
    moved = {"origin": origin.tolist()} if origin is not None and origin.any() else {}
    scaled = {"radiance_scale": radiance_scale} if radiance_scale != 1.0 else {}
    write_text(path, json.dumps({"camera_model": "PINHOLE", **moved, **scaled, "frames": frames}, indent=1) + "\n")


def read_origin(path: str | Path) -> np.ndarray:
    """(3,) float64 what was subtracted from the positions of the source of a dataset, metres; mostly zeros.

    Raises
    ------
    FiptError
        If the transforms.json is missing or damaged.
    """
    found = _stated(path, "origin", (0.0, 0.0, 0.0))
    if found.shape != (3,):
        raise FiptError(f"{path}: origin must be three numbers; found {found.tolist()}", "run the import again")
    return found


def read_radiance_scale(path: str | Path) -> float:
    """Factor from the source's radiance to that of a dataset's images, a power of two; 1 where nothing is stated.

    Raises
    ------
    FiptError
        If the transforms.json is missing or damaged.
    """
    found = _stated(path, "radiance_scale", 1.0)
    if found.shape != () or not found > 0:
        raise FiptError(
            f"{path}: radiance_scale must be a number above 0; found {found.tolist()}", "run the import again"
        )
    return float(found)


def _stated(path: str | Path, key: str, default: object) -> np.ndarray:
    """Finite float64 numbers that a dataset's transforms.json states for all its cameras."""
    existing_file(path, "transforms.json")
    try:
        found = np.array(json.loads(Path(path).read_text(encoding="utf-8")).get(key, default), np.float64)
        if not np.isfinite(found).all():
            raise ValueError(f"{key} must be finite; found {found}")
    except MALFORMED as error:
        raise FiptError(f"{path} is not a dataset's transforms.json ({error!r})", "run the import again") from error
    return found


def read_transforms(path: str | Path) -> list[Camera]:
    """Read the transforms.json of a dataset (as `write_transforms` writes it).

    Raises
    ------
    FiptError
        If the file is missing, not JSON, lacks a key, repeats a view name or holds a transform that is not rigid.
    """
    existing_file(path, "transforms.json")
    try:
        frames = json.loads(Path(path).read_text(encoding="utf-8"))["frames"]
        cameras = [
            Camera(
                name=check_name(Path(frame["file_path"]).stem, f"{path}: view"),
                split=frame["split"],
                width=int(frame["w"]),
                height=int(frame["h"]),
                fx=float(frame["fl_x"]),
                fy=float(frame["fl_y"]),
                cx=float(frame["cx"]),
                cy=float(frame["cy"]),
                world_from_camera=np.array(frame["transform_matrix"], np.float64),
            )
            for frame in frames
        ]
    except MALFORMED as error:
        raise FiptError(f"{path} is not a dataset's transforms.json ({error!r})", "run the import again") from error
    check_cameras(cameras, path)
    return cameras


def up_axis(cameras: list[Camera]) -> np.ndarray:
    """(3,) float64 world axis, or its opposite, that is nearest to the mean up direction of cameras.

    The source's world may have any axis up.
    """
    mean = np.mean([camera.world_from_camera[:3, 1] for camera in cameras], axis=0)
    axis = int(np.abs(mean).argmax())
    return np.eye(3)[axis] * (1.0 if mean[axis] > 0 else -1.0)


LEAST_BASELINE = 0.01
"""Of the distance of what is near, by which cameras must stand apart: less moves nothing by more than some pixels."""


def parallax(cameras: list[Camera], vertices: np.ndarray) -> tuple[float, float]:
    """How far apart cameras stand, and how far off the nearest quarter of the vertices (V, 3) is; both in metres.

    The first is twice the largest distance from the cameras' median position, the second the lower quartile of the
    distances from there: a far landscape counts little.
    """
    centers = np.array([camera.center for camera in cameras], np.float64)
    middle = np.median(centers, axis=0)
    away = np.linalg.norm(vertices - middle, axis=1)
    return 2 * float(np.linalg.norm(centers - middle, axis=1).max()), float(np.quantile(away, 0.25))


def check_cameras(cameras: list[Camera], path: str | Path) -> None:
    """Raise FiptError unless view names are unique, splits known, sizes positive and transforms rigid."""
    if not cameras:
        raise FiptError(f"{path} must list at least one frame; it lists none", "check the source's cameras")
    seen: set[str] = set()
    for camera in cameras:
        where = f"{path}, view {camera.name}"
        if camera.name in seen:
            raise FiptError(
                f"{path}: view names must be unique; {camera.name} occurs twice",
                "rename one of them",
            )
        seen.add(camera.name)
        if camera.split not in ("train", "val"):
            raise FiptError(f"{where}: split must be train or val; found {camera.split!r}", "correct the split")
        if min(camera.width, camera.height) < 1 or not (0 < camera.fx < np.inf and 0 < camera.fy < np.inf):
            raise FiptError(
                f"{where}: image size and focal lengths must be positive and finite", "correct the intrinsics"
            )
        if not _FOCAL[0] <= camera.fx / camera.width <= _FOCAL[1]:
            raise FiptError(
                f"{where}: a focal length must be {_FOCAL[0]:g} to {_FOCAL[1]:g} times as long as the image is wide; "
                f"found {camera.fx:g} of {camera.width} pixels",
                "correct the intrinsics",
            )
        if not 1 / _LONGEST <= camera.fx / camera.fy <= _LONGEST:
            raise FiptError(
                f"{where}: no pixel is {_LONGEST} times as long as it is wide; found focal lengths of {camera.fx:g} "
                f"and {camera.fy:g} pixels",
                "correct the intrinsics",
            )
        if not max(abs(camera.cx) / camera.width, abs(camera.cy) / camera.height) <= _FARTHEST:
            raise FiptError(
                f"{where}: the principal point must lie within {_FARTHEST} sizes of the image; found {camera.cx:g}, "
                f"{camera.cy:g} of {camera.width}x{camera.height}",
                "correct the intrinsics",
            )
        transform = camera.world_from_camera
        if transform.shape != (4, 4) or not (np.abs(transform) <= FARTHEST).all():
            raise FiptError(
                f"{where}: transform_matrix must be a 4x4 matrix of finite numbers, at most {FARTHEST:.0e}",
                "correct the pose",
            )
        rotation = transform[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
            raise FiptError(
                f"{where}: the rotation must be orthonormal with determinant 1; found determinant "
                f"{np.linalg.det(rotation):.3f} (a mirrored or scaled camera)",
                "correct the pose or leave the view out",
            )
