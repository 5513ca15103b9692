"""How far off the fitted material may be, by voxel and facing of the surface: confidence.npz beside a model.

Confidence in [0, 1] is the predicted error of kd in decibels: 0 at 10 dB, 1 at 35 dB, so that each of five classes of
equal width holds 5 dB.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.formats.arrays import load_npz, save_npz
from fipt.scene.voxels import FACINGS, facings, voxel_keys

_LEAST, _MOST = 10.0, 35.0
"""Decibels of confidence 0 and 1: a surface of which nothing is known has 10.8 dB; 35 dB is an error of 0.018."""


@dataclass(frozen=True)
class SurfaceRecords:
    """K records of the surface that training views see.

    Attributes
    ----------
    center, side, resolution
        The scene box (metres) and the voxels along it.
    record
        (K,) int64 sorted: voxel and facing.
    """

    center: np.ndarray
    side: float
    resolution: int
    record: np.ndarray

    def at(self, points: np.ndarray, normals: np.ndarray, values: np.ndarray, unseen: float = 0.0) -> np.ndarray:
        """(N,) float32 of (K,) ``values`` at surface points (N, 3) with normals (N, 3); ``unseen`` where none is."""
        wanted = records(points, normals, self.center, self.side, self.resolution)
        place = np.minimum(np.searchsorted(self.record, wanted), len(self.record) - 1)
        return np.where(self.record[place] == wanted, values[place], unseen).astype(np.float32)


@dataclass(frozen=True)
class Confidence(SurfaceRecords):
    """Predicted errors of the fitted material.

    Attributes
    ----------
    kd_error
        (K,) float32 standard error of kd, linear, mean over the channels.
    roughness_error, metallic_error
        (K,) float32 expected absolute errors.
    known
        (K,) bool: some pixel tells of it; not so where all that see it are clipped, masked, or show an emitter.
    unseen
        (3,) float32 the three errors where no training view sees the surface.
    """

    kd_error: np.ndarray
    roughness_error: np.ndarray
    metallic_error: np.ndarray
    known: np.ndarray
    unseen: np.ndarray

    @property
    def combined(self) -> np.ndarray:
        """(K,) float32 confidence in [0, 1]; 0 where nothing is known."""
        return np.where(self.known, confidence_of(self.kd_error), 0).astype(np.float32)

    def layers(self, points: np.ndarray, normals: np.ndarray) -> dict[str, np.ndarray]:
        """(N,) float32 ``confidence`` and the three errors at surface points (N, 3) with normals (N, 3)."""
        errors = ("kd_error", "roughness_error", "metallic_error")
        known = {
            name: self.at(points, normals, getattr(self, name), float(unseen))
            for name, unseen in zip(errors, self.unseen, strict=True)
        }
        return {"confidence": self.at(points, normals, self.combined), **known}


def confidence_of(kd_error: np.ndarray) -> np.ndarray:
    """Confidence in [0, 1] of a standard error of kd."""
    decibels = -20 * np.log10(np.maximum(kd_error, 1e-6))
    return np.clip((decibels - _LEAST) / (_MOST - _LEAST), 0, 1)


def records(points: np.ndarray, normals: np.ndarray, center: np.ndarray, side: float, resolution: int) -> np.ndarray:
    """(N,) int64 number of the voxel and facing of surface points (N, 3) with normals (N, 3)."""
    return voxel_keys(points, center, side, resolution) * FACINGS + facings(normals)


_ROWS = ("record", "kd_error", "roughness_error", "metallic_error", "known", "unseen")
_ARRAYS = ("center", "side", "resolution", *_ROWS)
_FORMS: dict[str, str] = dict(
    zip(
        _ARRAYS,
        ("finite 3", "amount", "number", "rising K", "float K", "float K", "float K", "bool K", "float 3"),
        strict=True,
    )
)


def write_confidence(path: str | Path, confidence: Confidence) -> None:
    """Write the records."""
    save_npz(path, **{name: np.asarray(getattr(confidence, name)) for name in _ARRAYS})


def read_confidence(path: str | Path) -> Confidence:
    """Read confidence.npz; FiptError where it is missing, damaged or something else."""
    arrays = load_npz(path, forms=_FORMS)
    rows = (arrays[name] for name in _ROWS)
    return Confidence(arrays["center"], float(arrays["side"]), int(arrays["resolution"]), *rows)
