"""Surface by voxel and facing: their keys, and cache.npz, the radiance cache as arrays."""

from pathlib import Path

import numpy as np

from fipt.formats.arrays import load_npz, save_npz

_ARRAYS = ("center", "side", "resolution", "key", "facing", "point", "radiance", "count", "source")

FACINGS = 6
"""Ways a surface may face in a voxel: both directions of each axis."""


def voxel_keys(points: np.ndarray, center: np.ndarray, side: float, resolution: int) -> np.ndarray:
    """(N,) int64 linear voxel index of (N, 3) points, x fastest; points outside go to the nearest voxel."""
    cell = np.floor((points - (center - side / 2)) * (resolution / side)).astype(np.int64)
    x, y, z = np.clip(cell, 0, resolution - 1).T
    return x + resolution * (y + resolution * z)


def facings(normals: np.ndarray) -> np.ndarray:
    """(N,) uint8 of (N, 3) normals: twice the axis nearest to them, plus one where they point along it."""
    axis = np.abs(normals).argmax(axis=1)
    return (2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)).astype(np.uint8)


def write_cache(path: str | Path, cache: dict[str, np.ndarray]) -> None:
    """Write the arrays of a radiance cache (`fipt.stages.cache.build.build` describes them)."""
    save_npz(path, **{name: cache[name] for name in _ARRAYS})


def read_cache(path: str | Path) -> dict[str, np.ndarray]:
    """Read a radiance cache; FiptError where the file is missing, damaged or something else."""
    return load_npz(path, required=_ARRAYS)
