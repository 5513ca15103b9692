"""What views straight down onto a wall show, which tests of the cut share."""

import numpy as np

from fipt.scene.cameras import Camera


def image(width: int, bright, over: int = 8) -> np.ndarray:
    """(width, width) luminance of a square of 2 m seen from straight above, 10 where ``bright(x, y)``, else 1."""
    x = (np.arange(width * over) + 0.5) / (width * over) * 2
    fine = np.where(bright(*np.meshgrid(x, x[::-1])), 10.0, 1.0)
    return fine.reshape(width, over, width, over).mean(axis=(1, 3))


def above(name: str, x: float, width: int = 60) -> Camera:
    """A view straight down onto the wall from 2 m, moved sideways."""
    pose = np.eye(4)
    pose[:3, 3] = x, 1, 2
    return Camera(name, "train", width, width, width, width, 0.5 * width * x, width / 2, pose)
