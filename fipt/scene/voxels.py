"""Surface by voxel and facing: their keys, and cache.npz, the radiance cache as arrays."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.files import made_again

_FORMS = {
    "center": "finite 3",
    "side": "amount",
    "resolution": "number",
    "key": "number N",
    "facing": "number N",
    "point": "finite N 3",
    "radiance": "amount N 3",
    "count": "amount N",
    "source": "number N",
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


def facing_normals(facing: np.ndarray) -> np.ndarray:
    """(N, 3) float32 unit vectors along the axes that surface of `facings` (N,) faces."""
    sign = 2 * (facing % 2).astype(np.float32) - 1
    return np.eye(3, dtype=np.float32)[facing // 2] * sign[:, None]


def write_cache(path: str | Path, cache: dict[str, np.ndarray]) -> None:
    """Write the arrays of a radiance cache (`fipt.stages.cache.build.build` describes them)."""
    save_npz(path, **{name: cache[name] for name in _FORMS})


def read_cache(path: str | Path) -> dict[str, np.ndarray]:
    """Read a radiance cache; FiptError where the file is missing, damaged or something else."""
    cache = load_npz(path, forms=_FORMS)
    side, resolution, size = float(cache["side"]), int(cache["resolution"]), len(cache["key"])
    if side <= 0 or not 0 < resolution <= _MOST or not size:
        raise FiptError(
            f"{path} must have a box of some size, and voxels; found side {side:g}, {resolution} voxels a side and "
            f"{size} records",
            made_again(path),
        )
    key, facing = cache["key"].astype(np.int64), cache["facing"].astype(np.int64)
    for what, right in (
        ("voxels of its box and their six sides", key.max() < resolution**3 and facing.max() < FACINGS),
        ("sorted by voxel and side", (np.diff(key * FACINGS + facing) > 0).all()),
        ("stood for by each other", cache["source"].max() < size),
    ):
        if not right:
            raise FiptError(f"{path}: its {size} records must be {what}; they are not", made_again(path))
    return cache


class SeenRadiance:
    """What a radiance cache says of points of seen surface; unseen voxels have the light of the nearest seen one."""

    def __init__(self, cache: Mapping[str, np.ndarray]) -> None:
        self._cache = cache
        self._key = cache["key"] * FACINGS + cache["facing"]
        self._radiance = cache["radiance"][cache["source"]]

    def at(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N, 3) radiance of (N, 3) points of surface that faces along (N, 3) normals; 0 where there is no record."""
        box = self._cache
        voxel = voxel_keys(points, box["center"], float(box["side"]), int(box["resolution"]))
        record = np.searchsorted(self._key, voxel * FACINGS + facings(normals))
        record = np.minimum(record, len(self._key) - 1)
        # another facing of the same voxel is better than none
        same = self._key[record] // FACINGS == voxel
        record = np.where(same, record, np.maximum(record - 1, 0))
        return np.where((self._key[record] // FACINGS == voxel)[:, None], self._radiance[record], 0.0)
