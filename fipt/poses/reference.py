"""Poses brought to a frame that is known: some of the cameras' positions from a survey or an earlier run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.io.sources import read_poses
from fipt.poses.model import Reconstruction
from fipt.poses.similarity import collinear, distances, robust_similarity

_TOLERANCE = 0.02
"""Distance of a camera from where the reference has it that still counts as right, share of the cameras' extent."""
_MOST = 0.5
"""Share of the common cameras that must be right."""


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
    rms, largest
        Distances of the fitted cameras from the reference, metres.
    """

    file: str
    cameras: tuple[str, ...]
    outliers: dict[str, float]
    scale: float
    rms: float
    largest: float


def to_reference(
    reconstruction: Reconstruction, path: str | Path, seed: int = 0
) -> tuple[np.ndarray, ReferenceReport]:
    """Fit the similarity that brings cameras to where a transforms.json has them; only positions count.

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
    known = {frame.name: np.array(frame.world_from_camera)[:3, 3] for frame in read_poses(path)}
    common = [index for index, camera in enumerate(reconstruction.cameras) if camera.name in known]
    names = [reconstruction.cameras[index].name for index in common]
    if len(common) < 3:
        raise FiptError(
            f"{path} must have the positions of at least 3 estimated cameras; it has {len(common)} "
            f"({', '.join(names) or 'none'})",
            "name its frames as the views, and add more",
        )
    source, target = reconstruction.centers[common], np.array([known[name] for name in names])
    tolerance = _TOLERANCE * float(np.linalg.norm(np.ptp(target, axis=0)))
    if collinear(target, tolerance / 4):
        raise FiptError(
            f"{path}: the positions of {', '.join(names[:5])} must not lie on one line: the turn about it stays open",
            "add a position beside the line",
        )
    similarity, good = robust_similarity(source, target, tolerance, seed)
    if good.sum() < max(3, _MOST * len(common)):
        raise FiptError(
            f"{path}: only {int(good.sum())} of {len(common)} positions fit the estimated cameras within "
            f"{tolerance:.3f} m",
            "check that the reference is of these pictures and in metres",
        )
    away = distances(similarity, source, target)
    return similarity, ReferenceReport(
        file=str(path),
        cameras=tuple(name for name, right in zip(names, good, strict=True) if right),
        outliers={name: float(d) for name, d, right in zip(names, away, good, strict=True) if not right},
        scale=float(np.cbrt(np.linalg.det(similarity[:3, :3]))),
        rms=float(np.sqrt((away[good] ** 2).mean())),
        largest=float(away[good].max()),
    )
