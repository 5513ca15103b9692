"""cache.npz: the radiance cache as arrays."""

from pathlib import Path

import numpy as np

from fipt.io.arrays import load_npz, save_npz

_ARRAYS = ("center", "side", "resolution", "key", "facing", "point", "radiance", "count", "source")


def write_cache(path: str | Path, cache: dict[str, np.ndarray]) -> None:
    """Write the arrays of a radiance cache (`fipt.shading.cache.build` describes them)."""
    save_npz(path, **{name: cache[name] for name in _ARRAYS})


def read_cache(path: str | Path) -> dict[str, np.ndarray]:
    """Read a radiance cache; FiptError where the file is missing, damaged or something else."""
    return load_npz(path, required=_ARRAYS)
