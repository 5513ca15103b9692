"""Surface of which no pixel tells the material: no view sees it, or only beside an emitter.

It belongs to a part whose materials are known, or lies beside one: bars before a window share all their pixels with the
panes, so that they are taken for what frames them.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from fipt.groups import most_frequent
from fipt.scene.voxels import FACINGS, along_surface, facing_normals, facings, voxel_keys
from fipt.stages.fit.batches import Pixels

_VOTERS = 64
"""Seen voxels around that which stands for unseen surface: half a disc of six voxels. What frames a wall has its border
a pixel or two beside the truth, and that is where unseen surface begins."""
_REACH = 8
"""How far they may lie, voxels: as far as surface that faces another way counts at least."""
_AT_ONCE = 1 << 14
"""Places that are voted on at a time: 100 MB."""


@dataclass(frozen=True)
class HiddenSurface:
    """Points of surface of which no pixel tells the material.

    Attributes
    ----------
    points
        (N, 3) float32 places to query, metres.
    segment
        (N,) int64 segment that tells it: of its other side, of seen surface nearby along it, or of what is beside.
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
    """Records of the radiance cache that no pixel teaches, with the segments that tell them.

    Parameters
    ----------
    cache
        As `fipt.scene.voxels.read_cache` returns it.
    known
        (S,) bool: segments of which anything is known; the others' surface is left alone, or takes what lies beside.
    """
    segment, taught, seen = _of_records(pixels, cache, known)
    segment[~known[segment]] = 0
    asks, gives = np.flatnonzero(seen & ~taught & (segment == 0)), taught & (segment > 0)
    if gives.any():
        beside = cKDTree(cache["point"][gives]).query(cache["point"][asks], workers=-1)[1]
        segment[asks] = segment[gives][beside]
    unseen = cache["source"] != np.arange(len(segment))
    segment[unseen] = _of_unseen(cache, segment, gives, unseen)[unseen]
    chosen = (unseen | (seen & ~taught)) & (segment > 0)
    place = cache["point"][chosen] - np.float32(pixels.inset) * facing_normals(cache["facing"][chosen])
    return HiddenSurface(place, segment[chosen], seen[chosen], float(cache["side"]) / int(cache["resolution"]))


def _of_unseen(cache: dict[str, np.ndarray], segment: np.ndarray, gives: np.ndarray, unseen: np.ndarray) -> np.ndarray:
    """(R,) int64 segment of each record that is ``unseen``: of its other side, or of surface around what stands for it.

    Surface has one material on both sides. Of two sides that no view sees that one decides that faces as what stands
    for it does, or else is nearer to it: the outside of a wall faces as the furniture before it does. Pixels teach the
    records that ``gives`` (R,) says.
    """
    number, source, other = np.arange(len(segment)), cache["source"].astype(np.int64), _other_sides(cache)
    far = np.linalg.norm(cache["point"] - cache["point"][source], axis=1)
    far += 2 * float(cache["side"]) * (cache["facing"] != cache["facing"][source])
    worse = (far > far[other]) | ((far == far[other]) & (number > other))
    tells = source[np.where(unseen[other] & worse, other, number)]
    found, stands = segment.copy(), np.unique(tells[unseen])
    stands = stands[gives[stands]]
    found[stands] = _around(cache, segment, gives, stands)
    return np.where(~unseen[other] & (segment[other] > 0), segment[other], found[tells])


def _other_sides(cache: dict[str, np.ndarray]) -> np.ndarray:
    """(R,) int64 number of the record of the other side of each one's surface; its own where there is none."""
    number, record = np.arange(len(cache["key"])), cache["key"] * FACINGS + cache["facing"]
    wanted = cache["key"] * FACINGS + (cache["facing"] ^ 1)
    other = np.minimum(np.searchsorted(record, wanted), len(number) - 1)
    return np.where((record[other] == wanted) & (cache["part"][other] == cache["part"]), other, number)


def _around(cache: dict[str, np.ndarray], segment: np.ndarray, gives: np.ndarray, asks: np.ndarray) -> np.ndarray:
    """(A,) int64: the most frequent segment of `_VOTERS` records that ``gives`` (R,) around each of ``asks`` (A,).

    Voters are of the same connected part of the mesh, nearest along the surface, and within `_REACH` voxels.
    """
    voted, along = segment[asks], cache["facing"] // 2
    reach = _REACH * float(cache["side"]) / int(cache["resolution"])
    for axis in range(3):
        # what faces along another axis counts as further away than any voter
        voters, rows = np.flatnonzero(gives & (along == axis)), np.flatnonzero(along[asks] == axis)
        if not len(voters):
            continue
        place = along_surface(cache, axis)
        tree = cKDTree(place[voters])
        for first in range(0, len(rows), _AT_ONCE):
            some = rows[first : first + _AT_ONCE]
            at = place[asks[some]]
            near = tree.query(at, k=range(1, _VOTERS + 1), distance_upper_bound=reach, workers=-1)[1]
            row, column = np.nonzero(near < len(voters))
            voted[some] = most_frequent(row, segment[voters[near[row, column]]], voted[some])
    return voted


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
