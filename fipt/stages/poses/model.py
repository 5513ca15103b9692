"""What pose estimation finds: cameras, the points they share, and where each camera saw them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fipt.scene.cameras import Camera


class Tracks(NamedTuple):
    """Observations of points in views, flat over M observations.

    Attributes
    ----------
    view
        (M,) int64 index into the reconstruction's cameras.
    point
        (M,) int64 index into its points.
    pixel
        (M, 2) float32 image coordinates (column, row); the centre of the top left pixel is (0.5, 0.5).
    """

    view: np.ndarray
    point: np.ndarray
    pixel: np.ndarray


@dataclass(frozen=True)
class Reconstruction:
    """Cameras and points in one frame, of arbitrary scale until they are aligned.

    Attributes
    ----------
    cameras
        ``world_from_camera`` in the project's axes (docs/reference/conventions.md).
    points
        (P, 3) float64 world positions.
    errors
        (P,) float32 mean reprojection error of each point, pixels.
    tracks
        Which camera saw which point where.
    """

    cameras: tuple[Camera, ...]
    points: np.ndarray
    errors: np.ndarray
    tracks: Tracks

    @property
    def centers(self) -> np.ndarray:
        """(C, 3) float64 positions of the cameras."""
        return np.array([camera.center for camera in self.cameras]).reshape(-1, 3)


def transformed(reconstruction: Reconstruction, similarity: np.ndarray) -> Reconstruction:
    """Move cameras and points by a similarity; cameras stay rigid, so that the scale goes into their positions.

    Parameters
    ----------
    reconstruction
        What to move.
    similarity
        (4, 4) new_from_old: scale times rotation, and a translation.
    """
    similarity = np.asarray(similarity, np.float64)
    linear, shift = similarity[:3, :3], similarity[:3, 3]
    rotation = linear / np.cbrt(np.linalg.det(linear))
    cameras = []
    for camera in reconstruction.cameras:
        pose = np.eye(4)
        pose[:3, :3] = rotation @ camera.world_from_camera[:3, :3]
        pose[:3, 3] = linear @ camera.center + shift
        cameras.append(replace(camera, world_from_camera=pose))
    return replace(reconstruction, cameras=tuple(cameras), points=reconstruction.points @ linear.T + shift)
