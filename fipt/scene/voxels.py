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
    "part": "number N",
}
_MOST = 1 << 20
"""Voxels a side: their numbers then fit into 64 bits."""

FACINGS = 6
"""Ways a surface may face in a voxel: both directions of each axis."""
_OFF_PLANE = 4.0
"""How much further what lies off the plane of unseen surface counts. Where balls of 0.6 m of a scan were hidden, 1.2 %
of their surface came out three times too bright, instead of 1.5 %; in a clean room it made no difference."""
_TURN = 8
"""Voxels that surface which faces another way counts as further away."""


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


def along_surface(cache: Mapping[str, np.ndarray], axis: int) -> np.ndarray:
    """(K, 7) places of a cache's records, near each other where one may stand for another that faces along ``axis``.

    What lies off the plane of that surface is `_OFF_PLANE` times as far, and what faces another way `_TURN` voxels
    further: ceilings go on. By the last column, records of another connected part are further than all of the same one.
    """
    points = cache["point"]
    scaled = points * np.where(np.arange(3) == axis, np.float32(_OFF_PLANE), np.float32(1))
    turned = _TURN * float(cache["side"]) / int(cache["resolution"]) * facing_normals(cache["facing"])
    separation = 4.0 * _OFF_PLANE * (float(np.ptp(points, axis=0).max()) + 1.0)
    return np.concatenate([scaled, turned, cache["part"][:, None] * separation], axis=1)


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
