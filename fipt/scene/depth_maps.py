"""Depth maps on disk: an EXR of each view with depth, confidence and normal of the surface in every pixel."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr

_NORMAL = ("normal.X", "normal.Y", "normal.Z")
_SCALARS = ("depth", "confidence")


@dataclass(frozen=True)
class DepthMap:
    """What a view knows of the surface in each of its pixels.

    Attributes
    ----------
    depth
        (H, W) float32 distance along the camera's viewing axis of the surface at the pixel's centre, metres; 0 where
        unknown.
    confidence
        (H, W) float32 in [0, 1]; 0 where the depth is unknown.
    normal
        (H, W, 3) float32 unit normals in world axes, facing the camera; 0 where unknown.
    """

    depth: np.ndarray
    confidence: np.ndarray
    normal: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """(H, W) bool: pixels with a depth."""
        return self.depth > 0


def write_depth_map(path: str | Path, depth_map: DepthMap) -> None:
    """Write a depth map to an EXR file with the channels depth, confidence and normal.X, .Y, .Z."""
    channels = {"depth": depth_map.depth, "confidence": depth_map.confidence}
    channels |= {name: depth_map.normal[..., axis] for axis, name in enumerate(_NORMAL)}
    write_exr(path, channels)


def read_depth_map(path: str | Path) -> DepthMap:
    """Read what `write_depth_map` wrote.

    Raises
    ------
    FiptError
        If a channel is missing, a value is not finite, a depth is negative or a confidence outside [0, 1].
    """
    channels = read_exr(path, required=_SCALARS + _NORMAL)
    for name in _SCALARS + _NORMAL:
        values = channels[name]
        least, most = (0.0, np.inf) if name == "depth" else (0.0, 1.0) if name == "confidence" else (-1.001, 1.001)
        bad = ~(np.isfinite(values) & (values >= least) & (values <= most))
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise FiptError(
                f"{path}: {name} must be finite, from {least:g} to {most:g}; found {values[row, column]:g} "
                f"in row {row}, column {column}",
                "run fipt depth again, or write depth in metres, 0 where it is unknown",
            )
    normal = np.stack([channels[name] for name in _NORMAL], axis=-1)
    return DepthMap(channels["depth"], channels["confidence"], normal)
