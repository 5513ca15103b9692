"""Tiny sources in every layout that `fipt import` reads: a box room, three poses, 8x6 pictures.

Poses are given physically (where the camera stands, what it has to its right, above and ahead), and
each writer puts them down in its own layout's axes. One pixel of every picture is bright: the one
that shows `LAMP`. So a test that projects LAMP with an imported camera proves the axes.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.mesh import Mesh, write_ply

WIDTH, HEIGHT, FOCAL = 8, 6, 4.0
"""Pictures of 90 degrees across."""
LAMP = np.array([2.9, 2.3, 1.2])
BRIGHT = 50.0


@dataclass(frozen=True)
class Pose:
    """Where a camera stands and its unit directions in world space."""

    origin: np.ndarray
    right: np.ndarray
    up: np.ndarray
    forward: np.ndarray

    def pixel(self, point: np.ndarray) -> tuple[int, int]:
        """Row and column that show a point."""
        d = point - self.origin
        ahead = d @ self.forward
        assert ahead > 0
        column = WIDTH / 2 + FOCAL * (d @ self.right) / ahead
        row = HEIGHT / 2 - FOCAL * (d @ self.up) / ahead
        return int(row), int(column)


def pose(origin: tuple[float, ...], at: tuple[float, ...]) -> Pose:
    """A level camera that looks at a point; y is up in the world."""
    forward = np.subtract(at, origin) / np.linalg.norm(np.subtract(at, origin))
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return Pose(np.array(origin, float), right, np.cross(right, forward), forward)


POSES = (
    pose((1.0, 1.5, 4.2), (2.2, 1.9, 1.0)),
    pose((3.4, 1.2, 4.0), (2.4, 1.7, 0.8)),
    pose((0.7, 1.8, 1.0), (3.2, 1.6, 1.8)),
)


def room() -> Mesh:
    """A box of 4 x 3 x 5 metres, 12 triangles."""
    corners = np.array([[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 5)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(triangles, np.int32))


def photo(pose: Pose) -> np.ndarray:
    """(6, 8, 3) float32 radiance of a room's level: a gradient, and the bright pixel of the lamp."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    radiance = np.stack([0.6 * rows / HEIGHT, 0.6 * columns / WIDTH, 0.25 + 0 * rows], -1).astype(np.float32)
    radiance[pose.pixel(LAMP)] = BRIGHT
    return radiance


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write a Wavefront mesh."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles]
    path.write_text("\n".join(lines) + "\n")


def matrix(pose: Pose, signs: tuple[int, int, int]) -> list[list[float]]:
    """Camera to world where the camera's axes are right, up, backward times ``signs``."""
    axes = np.stack([pose.right, pose.up, -pose.forward], axis=1) * signs
    return np.vstack([np.column_stack([axes, pose.origin]), [0, 0, 0, 1]]).tolist()


def write_nerfstudio(root: Path, **keys: object) -> dict:
    """transforms.json with shared intrinsics, images/, mesh.ply; ``keys`` replace shared ones."""
    frames = []
    for index, view in enumerate(POSES):
        write_exr(root / "images" / f"view_{index}.exr", {"": photo(view)})
        frames.append({"file_path": f"images/view_{index}.exr", "transform_matrix": matrix(view, (1, 1, 1))})
    content = {
        "camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL,
        "cx": WIDTH / 2, "cy": HEIGHT / 2, "k1": 0.0, "k2": 0, "p1": 0.0, "p2": 0.0,
        "frames": frames, **keys,
    }  # fmt: skip
    write_ply(root / "mesh.ply", room())
    (root / "transforms.json").write_text(json.dumps(content))
    return content


def write_masked(root: Path, radiance: np.ndarray, flags: np.ndarray) -> None:
    """The same, where the first view has radiance and flags of one's own, and its first pixel is NaN and masked."""
    content = write_nerfstudio(root)
    radiance[0, 0] = np.nan
    write_exr(root / "images" / "view_0.exr", {"": radiance, "flags.Y": flags})
    mask = np.full(flags.shape, 255, np.uint8)
    mask[0, 0] = 0
    write_png(root / "mask.png", mask)
    content["frames"][0]["mask_path"] = "mask.png"
    (root / "transforms.json").write_text(json.dumps(content))


def write_blender(root: Path) -> None:
    """transforms_train.json and transforms_val.json, frames numbered separately, no suffix."""
    for split, poses in (("train", POSES[:2]), ("val", POSES[2:])):
        frames = []
        for index, view in enumerate(poses):
            write_exr(root / split / f"r_{index}.exr", {"": photo(view)})
            frames.append({"file_path": f"./{split}/r_{index}", "transform_matrix": matrix(view, (1, 1, 1))})
        content = {"camera_angle_x": np.pi / 2, "frames": frames}
        (root / f"transforms_{split}.json").write_text(json.dumps(content))
    write_ply(root / "mesh.ply", room())


def truth_layers(view: Pose) -> dict[str, np.ndarray]:
    """Truth of a picture by folder of the FIPT synthetic layout."""
    base = np.clip(photo(view), 0, 0.8)
    emission = np.where(photo(view) == BRIGHT, photo(view), 0)
    ids = np.arange(HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH) // 16
    return {
        "DiffCol": base,
        "BaseColor": base,
        "albedo": base + 0.04,
        "Emit": emission,
        "Roughness": np.full((HEIGHT, WIDTH, 3), 0.4),
        "Metallic": np.zeros((HEIGHT, WIDTH, 3)),
        "IndexMA": np.repeat(ids[..., None] + 300, 3, axis=-1),
        "segmentation": np.repeat(ids[..., None], 3, axis=-1),
    }


def write_synthetic(root: Path) -> None:
    """The FIPT synthetic layout with all truth; camera axes x left, y up, z forward."""
    for split, poses in (("train", POSES[:2]), ("val", POSES[2:])):
        frames = []
        for index, view in enumerate(poses):
            write_exr(root / split / "Image" / f"{index:03d}_0001.exr", {"": photo(view)})
            for folder, values in truth_layers(view).items():
                suffix = "" if folder in ("albedo", "segmentation") else "_0001"
                write_exr(root / split / folder / f"{index:03d}{suffix}.exr", {"": values})
            frames.append({"file_path": f"{index:03d}", "transform_matrix": matrix(view, (-1, 1, -1))})
        content = {"camera_angle_x": np.pi / 2, "frames": frames}
        (root / split / "transforms.json").write_text(json.dumps(content))
    write_obj(root / "scene.obj", room())
    (root / "meta.json").write_text(json.dumps({"materials": [{"name": "Wall"}, {"name": "Oak"}]}))


def write_real(root: Path) -> None:
    """The FIPT real layout: look-at cameras, one K each, no split."""
    cameras, calibrations = [str(len(POSES))], [str(len(POSES))]
    for index, view in enumerate(POSES):
        write_exr(root / "Image" / f"{index:03d}_0001.exr", {"": photo(view)})
        write_exr(
            root / "segmentation" / f"{index:03d}.exr",
            {"": truth_layers(view)["segmentation"]},
        )
        for point in (view.origin, view.origin + view.forward, view.up):
            cameras.append(" ".join(f"{x:.9f}" for x in point))
        for row in ((FOCAL, 0, WIDTH / 2), (0, FOCAL, HEIGHT / 2), (0, 0, 1)):
            calibrations.append(" ".join(f"{x:.6f}" for x in row))
    (root / "cam.txt").write_text("\n".join(cameras) + "\n")
    (root / "K_list.txt").write_text("\n".join(calibrations) + "\n")
    write_obj(root / "scene.obj", room())


WRITERS: dict[str, Callable[[Path], object]] = {
    "nerfstudio": write_nerfstudio,
    "fipt-synthetic": write_synthetic,
    "fipt-real": write_real,
}
