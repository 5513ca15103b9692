"""Baked shading on disk."""

from pathlib import Path

import numpy as np

from fipt.io.arrays import load_npy, save_npy


def save_shading(folder: Path, shading: np.ndarray) -> None:
    """Write the (H, 13, 3) float16 shading of a shard into an existing folder."""
    save_npy(folder / "shading.npy", shading)


def read_shading(folder: str | Path) -> np.ndarray:
    """(H, 13, 3) float16 shading of a shard, memory-mapped."""
    return load_npy(Path(folder) / "shading.npy")
