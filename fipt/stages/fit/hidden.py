"""Surface of which no pixel tells the material: no view sees it, or only beside an emitter.

It belongs to a part whose materials are known, or lies beside one: bars before a window share all their pixels with the
panes, so that they are taken for what frames them.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from fipt.scene.voxels import FACINGS, facing_normals, facings, voxel_keys
from fipt.stages.fit.batches import Pixels


@dataclass(frozen=True)
class HiddenSurface:
    """Points of surface of which no pixel tells the material.

    Attributes
    ----------
    points
        (N, 3) float32 places to query, metres.
    segment
        (N,) int64 segment that tells it: of the nearest seen surface of the same connected part, or of what is beside.
    seen
        (N,) bool: views see it, in pixels that teach nothing.
    size
        Width of the voxels they stand for, metres.
    """

    points: np.ndarray
    segment: np.ndarray
    seen: np.ndarray
    size: float

    def __len__(self) -> int:
        return len(self.points)

    def drawn(self, count: int, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Points (count, 3), segments (count,) and sizes (count,) of a random choice.

        Seen and unseen surface have half of it each: the former is far less, and images show it.
        """
        groups = [group for group in (np.flatnonzero(~self.seen), np.flatnonzero(self.seen)) if len(group)]
        shares = np.diff(np.linspace(0, count, len(groups) + 1).astype(int))
        draws = [group[rng.integers(0, len(group), share)] for group, share in zip(groups, shares, strict=True)]
        chosen = np.concatenate(draws)
        size = torch.full((count,), self.size)
        return torch.from_numpy(self.points[chosen]), torch.from_numpy(self.segment[chosen]), size


def find_hidden(pixels: Pixels, cache: dict[str, np.ndarray], known: np.ndarray) -> HiddenSurface:
    """Records of the radiance cache that no pixel teaches, with the segments of those that stand for them.

    Parameters
    ----------
    cache
        As `fipt.scene.voxels.read_cache` returns it.
    known
        (S,) bool: segments of which anything is known; the others' surface is left alone, or takes what lies beside.
    """
    segment, taught, seen = _of_records(pixels, cache, known)
    labelled = (segment > 0) & known[segment]
    asks, gives = np.flatnonzero(seen & ~taught & ~labelled), taught & labelled
    if gives.any():
        beside = cKDTree(cache["point"][gives]).query(cache["point"][asks], workers=-1)[1]
        segment[asks] = segment[gives][beside]
    segment = segment[cache["source"]]
    unseen = cache["source"] != np.arange(len(segment))
    chosen = (unseen | (seen & ~taught)) & (segment > 0) & known[segment]
    place = cache["point"][chosen] - np.float32(pixels.inset) * facing_normals(cache["facing"][chosen])
    return HiddenSurface(place, segment[chosen], seen[chosen], float(cache["side"]) / int(cache["resolution"]))


def _of_records(
    pixels: Pixels, cache: dict[str, np.ndarray], known: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each record (R,): int64 segment, 0 = none; bool, whether a pixel teaches it; bool, whether one sees it.

    The segment is that of pixels that teach, if there are any of a known one.
    """
    center, side, resolution = cache["center"], float(cache["side"]), int(cache["resolution"])
    records = cache["key"] * FACINGS + cache["facing"]
    taught, seen = np.zeros((2, len(records)), bool)
    any_segment, taught_segment = np.zeros((2, len(records)), np.int64)
    for number, shard in enumerate(pixels.shards):
        for index in range(len(shard.views)):
            own = shard.of_view(index)
            pixel = shard.pixels(index).start + shard.pixel_of_sample(index)
            record = voxel_keys(shard.position[own], center, side, resolution) * FACINGS + facings(shard.normal[own])
            place = np.minimum(np.searchsorted(records, record), len(records) - 1)
            ids = pixels.segment_of(np.full(len(pixel), number), pixel, np.arange(own.start, own.stop))
            found = records[place] == record
            teaches = found & (pixels.valid[number][pixel] > 0)
            seen[place[found]] = True
            taught[place[teaches]] = True
            for segment, chosen in (
                (any_segment, found & (ids > 0)),
                (taught_segment, teaches & (ids > 0) & known[ids]),
            ):
                segment[place[chosen]] = ids[chosen]
    return np.where(taught_segment > 0, taught_segment, any_segment), taught, seen
