"""Baked shading on disk."""

from pathlib import Path

import numpy as np

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.io.arrays import load_npy, save_npy
from fipt.io.hits import Hits, read_hits


def save_shading(folder: Path, shading: np.ndarray) -> None:
    """Write the (H, 13, 3) float16 shading of a shard into an existing folder."""
    save_npy(folder / "shading.npy", shading)


def read_shading(folder: str | Path, hits: Hits | None = None) -> np.ndarray:
    """(H, 13, 3) float16 shading of a shard, memory-mapped; checked against its hits where they are given.

    Raises
    ------
    FiptError
        If it is missing or is not the shading of ``hits``.
    """
    shading = load_npy(Path(folder) / "shading.npy")
    expected = (len(shading if hits is None else hits.position), SHADING_OUTPUTS, 3)
    if shading.shape != expected:
        raise FiptError(
            f"{folder} must hold shading of shape {expected} for its hits; found {shading.shape}",
            "give the shading of the same shard, or bake it again",
        )
    return shading


def read_shards(hits: list[str], shading: list[str]) -> tuple[list[Hits], list[np.ndarray]]:
    """Read hits shards and the shading of each, given in the same order."""
    if len(hits) != len(shading):
        raise FiptError(
            f"--hits and --shading must name as many shards; {len(hits)} and {len(shading)} given",
            "give the same shards in the same order",
        )
    shards = [read_hits(folder) for folder in hits]
    return shards, [read_shading(folder, shard) for folder, shard in zip(shading, shards, strict=True)]


def brightest_reflection(shading: np.ndarray) -> np.ndarray:
    """(H,) float32 mean over RGB of what a white surface or a mirror would show, whichever is more, of (H, 13, 3)."""
    levels = len(ROUGHNESS_LEVELS)
    mirror = (shading[:, 1 : 1 + levels] + shading[:, 1 + levels :]).max(axis=1)
    return np.maximum(shading[:, 0], mirror).mean(axis=1)
