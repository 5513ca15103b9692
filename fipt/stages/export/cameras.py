"""Cameras as COLMAP's text model: cameras.txt, images.txt, points3D.txt; names of cameras in files that allow few."""

from collections.abc import Sequence
from itertools import count
from pathlib import Path

from fipt.formats.files import write_text
from fipt.scene.cameras import Camera


def distinct(names: Sequence[str]) -> list[str]:
    """The same names; one that was there before, since characters were lost, gets a number."""
    found: list[str] = []
    for number, name in enumerate(names):
        others = (f"{name}__{k}" for k in count(number))
        found.append(name if name not in found else next(k for k in others if k not in found and k not in names))
    return found


def write_colmap(folder: Path, cameras: Sequence[Camera]) -> None:
    """Write the poses of views; there are no points."""
    from scipy.spatial.transform import Rotation

    models, images = ["# id, model, width, height, fx, fy, cx, cy"], ["# id, q (w x y z), t, camera, name; then points"]
    for number, camera in enumerate(cameras, 1):
        intrinsics = " ".join(repr(float(v)) for v in (camera.fx, camera.fy, camera.cx, camera.cy))
        models.append(f"{number} PINHOLE {camera.width} {camera.height} {intrinsics}")
        x, y, z, w = Rotation.from_matrix(camera.extrinsics[:, :3]).as_quat(canonical=True)
        numbers = " ".join(repr(float(v)) for v in (w, x, y, z, *camera.extrinsics[:, 3]))
        images += [f"{number} {numbers} {number} {camera.name}.exr", ""]
    texts = {"cameras.txt": models, "images.txt": images, "points3D.txt": ["# none"]}
    for name, lines in texts.items():
        write_text(folder / name, "\n".join(lines) + "\n")
