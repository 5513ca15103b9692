"""How well the photographs determine the surface, by voxel and facing: confidence.npz beside a model."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.formats.arrays import load_npz, save_npz
from fipt.scene.voxels import FACINGS, facings, voxel_keys


@dataclass(frozen=True)
class Confidence:
    """K records of the surface that training views see; what has no record is seen by none.

    Attributes
    ----------
    center, side, resolution
        The scene box (metres) and the voxels along it.
    record
        (K,) int64 sorted: voxel and facing.
    views
        (K,) float32 in [0, 1]: evidence for the base colour, from number, angle and agreement of the views.
    highlights
        (K,) float32 in [0, 1]: evidence for roughness and metallic, from the light that they would change.
    """

    center: np.ndarray
    side: float
    resolution: int
    record: np.ndarray
    views: np.ndarray
    highlights: np.ndarray

    @property
    def combined(self) -> np.ndarray:
        """(K,) the confidence in the material as a whole: half of it needs highlights, all of it views."""
        return (self.views * (0.5 + 0.5 * self.highlights)).astype(np.float32)

    def at(self, points: np.ndarray, normals: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(N,) float32 of (K,) ``values`` at surface points (N, 3) with normals (N, 3); 0 where no view sees them."""
        wanted = records(points, normals, self.center, self.side, self.resolution)
        place = np.minimum(np.searchsorted(self.record, wanted), len(self.record) - 1)
        return np.where(self.record[place] == wanted, values[place], 0).astype(np.float32)


def records(points: np.ndarray, normals: np.ndarray, center: np.ndarray, side: float, resolution: int) -> np.ndarray:
    """(N,) int64 number of the voxel and facing of surface points (N, 3) with normals (N, 3)."""
    return voxel_keys(points, center, side, resolution) * FACINGS + facings(normals)


_ARRAYS = ("center", "side", "resolution", "record", "views", "highlights")


def write_confidence(path: str | Path, confidence: Confidence) -> None:
    """Write the records."""
    save_npz(path, **{name: np.asarray(getattr(confidence, name)) for name in _ARRAYS})


def read_confidence(path: str | Path) -> Confidence:
    """Read confidence.npz; FiptError where it is missing, damaged or something else."""
    arrays = load_npz(path, required=_ARRAYS)
    return Confidence(
        arrays["center"],
        float(arrays["side"]),
        int(arrays["resolution"]),
        *(arrays[name] for name in ("record", "views", "highlights")),
    )
