"""Poses brought to a frame that is known: some of the cameras' positions from a survey or an earlier run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.scene.sources import read_poses
from fipt.stages.poses.model import Reconstruction
from fipt.stages.poses.similarity import collinear, common_turn, distances, matrix, robust_similarity, rotation_angles

_TOLERANCE = 0.02
"""Distance of a camera from where the reference has it that still counts as right, share of the cameras' extent."""
_MOST = 0.5
"""Share of the common cameras that must be right."""
_DIRECTED = 3.0
"""Median angle to the estimated directions up to which a reference knows directions too, degrees."""


@dataclass(frozen=True)
class ReferenceReport:
    """How poses fit a reference.

    Attributes
    ----------
    file
        The reference.
    cameras
        Names of the cameras that were fitted.
    outliers
        Camera that does not fit, left out -> its distance from the reference, metres.
    scale
        Metres of one unit of the reconstruction.
    directions
        Median angle between directions and those of the reference, degrees; None where it knows only positions.
    rms, largest
        Distances of the fitted cameras from the reference, metres.
    """

    file: str
    cameras: tuple[str, ...]
    outliers: dict[str, float]
    scale: float
    directions: float | None
    rms: float
    largest: float


def to_reference(reconstruction: Reconstruction, path: str | Path, seed: int = 0) -> tuple[np.ndarray, ReferenceReport]:
    """Fit the similarity that brings cameras to where a transforms.json has them.

    A survey may know positions only: directions count where they fit, and then tell the rotation far better.

    Parameters
    ----------
    reconstruction
        Estimated cameras.
    path
        Poses of some of the views, by view name, metres.
    seed
        Of the robust fit.

    Returns
    -------
    metres_from_reconstruction
        (4, 4) similarity.
    report
        What it was fitted to, and how well.

    Raises
    ------
    FiptError
        Fewer than three common cameras, cameras on a line, or no majority that fits.
    """
    names, cameras, poses = _common(reconstruction, path)
    source, target = cameras[:, :3, 3], poses[:, :3, 3]
    tolerance = _TOLERANCE * float(np.linalg.norm(np.ptp(target, axis=0)))
    if collinear(target, tolerance / 4):
        raise FiptError(
            f"{path}: the positions of {', '.join(names[:5])} must not lie on one line: the turn about it stays open",
            "add a position beside the line",
        )
    similarity, good = robust_similarity(source, target, tolerance, seed)
    if good.sum() < max(3, _MOST * len(names)):
        raise FiptError(
            f"{path}: only {int(good.sum())} of {len(names)} positions fit the estimated cameras within "
            f"{tolerance:.3f} m",
            "check that the reference is of these images and in metres",
        )
    rotation = similarity[:3, :3] / np.cbrt(np.linalg.det(similarity[:3, :3]))
    angle: float | None = _angle(rotation, cameras[good], poses[good])
    if angle > _DIRECTED:
        angle = None
    else:
        rotation = common_turn(cameras[good], poses[good])
        similarity = _with_rotation(rotation, source[good], target[good])
        angle = _angle(rotation, cameras[good], poses[good])
    away = distances(similarity, source, target)
    return similarity, ReferenceReport(
        file=str(path),
        cameras=tuple(name for name, right in zip(names, good, strict=True) if right),
        outliers={name: float(d) for name, d, right in zip(names, away, good, strict=True) if not right},
        scale=float(np.cbrt(np.linalg.det(similarity[:3, :3]))),
        directions=angle,
        rms=float(np.sqrt((away[good] ** 2).mean())),
        largest=float(away[good].max()),
    )


def _common(reconstruction: Reconstruction, path: str | Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, and (N, 4, 4) poses in the reconstruction and in the reference, of the cameras that both have."""
    known = {frame.name: np.array(frame.world_from_camera) for frame in read_poses(path)}
    common = [index for index, camera in enumerate(reconstruction.cameras) if camera.name in known]
    names = [reconstruction.cameras[index].name for index in common]
    if len(common) < 3:
        raise FiptError(
            f"{path} must have the positions of at least 3 estimated cameras; it has {len(common)} "
            f"({', '.join(names) or 'none'})",
            "name its frames as the views, and add more",
        )
    cameras = np.array([reconstruction.cameras[index].world_from_camera for index in common])
    return names, cameras, np.array([known[name] for name in names])


def _angle(rotation: np.ndarray, cameras: np.ndarray, poses: np.ndarray) -> float:
    """Median angle between the directions of turned cameras and of poses, degrees."""
    return float(np.median(rotation_angles(rotation @ cameras[:, :3, :3], poses[:, :3, :3])))


def _with_rotation(rotation: np.ndarray, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Least-squares similarity of this rotation between (N, 3) points."""
    a, b = (source - source.mean(axis=0)) @ rotation.T, target - target.mean(axis=0)
    scale = float((a * b).sum() / (a * a).sum())
    return matrix(scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0))
