"""Surface by voxel and facing: their keys, and cache.npz, the radiance cache as arrays."""

from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.files import made_again

_FORMS = {
    "center": "finite 3",
    "side": "finite",
    "resolution": "int",
    "key": "int N",
    "facing": "int N",
    "point": "float N 3",
    "radiance": "finite N 3",
    "count": "finite N",
    "source": "int N",
}
_MOST = 1 << 20
"""Voxels a side: their numbers then fit into 64 bits."""

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
    save_npz(path, **{name: cache[name] for name in _FORMS})


def read_cache(path: str | Path) -> dict[str, np.ndarray]:
    """Read a radiance cache; FiptError where the file is missing, damaged or something else."""
    cache = load_npz(path, forms=_FORMS)
    side, resolution, least = float(cache["side"]), int(cache["resolution"]), cache["radiance"].min(initial=0.0)
    if side <= 0 or not 0 < resolution <= _MOST or least < 0 or not len(cache["key"]):
        raise FiptError(
            f"{path} must have a box of some size, voxels, and radiance >= 0; found side {side:g}, {resolution} voxels "
            f"a side, {len(cache['key'])} records and radiance from {least:g}",
            made_again(path),
        )
    return cache
