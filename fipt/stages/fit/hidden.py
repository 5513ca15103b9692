"""Surface that no training view sees: it has no pixels, but it belongs to a part whose materials are known."""

from dataclasses import dataclass

import numpy as np
import torch

from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.fit.batches import Pixels


@dataclass(frozen=True)
class HiddenSurface:
    """Points of unseen surface.

    Attributes
    ----------
    points
        (N, 3) float32, metres.
    segment
        (N,) int64 segment of the nearest seen surface of the same connected part.
    size
        Width of the voxels they stand for, metres.
    """

    points: np.ndarray
    segment: np.ndarray
    size: float

    def __len__(self) -> int:
        return len(self.points)

    def drawn(self, count: int, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Points (count, 3), segments (count,) and sizes (count,) of a random choice."""
        chosen = rng.integers(0, len(self), count)
        size = torch.full((count,), self.size)
        return torch.from_numpy(self.points[chosen]), torch.from_numpy(self.segment[chosen]), size


def find_hidden(pixels: Pixels, cache: dict[str, np.ndarray], known: np.ndarray) -> HiddenSurface:
    """Unseen records of the radiance cache, with the segments of those that stand for them.

    Parameters
    ----------
    cache
        As `fipt.scene.voxels.read_cache` returns it.
    known
        (S,) bool: segments of which anything is known; the others' surface is left alone.
    """
    center, side, resolution = cache["center"], float(cache["side"]), int(cache["resolution"])
    records = cache["key"] * FACINGS + cache["facing"]
    segment = np.zeros(len(records), np.int64)
    for number, shard in enumerate(pixels.shards):
        for index in range(len(shard.views)):
            own = shard.of_view(index)
            pixel = shard.pixels(index).start + shard.pixel_of_sample(index)
            record = voxel_keys(shard.position[own], center, side, resolution) * FACINGS + facings(shard.normal[own])
            place = np.minimum(np.searchsorted(records, record), len(records) - 1)
            ids = pixels.segment_of(np.full(len(pixel), number), pixel, np.arange(own.start, own.stop))
            known_here = (records[place] == record) & (ids > 0)
            segment[place[known_here]] = ids[known_here]
    segment = segment[cache["source"]]
    chosen = (cache["source"] != np.arange(len(records))) & (segment > 0) & known[segment]
    return HiddenSurface(cache["point"][chosen], segment[chosen], side / resolution)
