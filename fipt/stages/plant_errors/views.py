"""Errors of views: cameras that are turned, exposures that are off."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fipt.formats.exr import read_exr, write_exr
from fipt.scene.cameras import Camera


def turned_cameras(cameras: Sequence[Camera], degrees: float, rng: np.random.Generator) -> list[Camera]:
    """The cameras, those of training views turned by ``degrees`` about random axes through their centres."""
    result = []
    for camera in cameras:
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
        pose = camera.world_from_camera.copy()
        pose[:3, :3] = turn @ pose[:3, :3]
        result.append(replace(camera, world_from_camera=pose) if camera.split == "train" else camera)
    return result


def exposures(views: Sequence[str], stops: float, share: float, rng: np.random.Generator) -> dict[str, float]:
    """View -> factor on its radiance, of a share of the views, at least one if any: up and down in turn."""
    count = max(1, round(share * len(views))) if share > 0 else 0
    chosen = rng.permutation(len(views))[:count]
    return {views[int(index)]: 2.0 ** (stops if k % 2 == 0 else -stops) for k, index in enumerate(chosen)}


def scale_image(path: Path, factor: float) -> None:
    """Multiply the radiance of an image; its other layers stay. A file that others share is not touched."""
    channels = read_exr(path)
    scaled = {name: values * np.float32(factor) if name in "RGB" else values for name, values in channels.items()}
    write_exr(path, scaled)
