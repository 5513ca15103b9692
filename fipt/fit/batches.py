"""Training data of the fit: pixels, the surface pieces they show, baked shading and segment ids."""

from dataclasses import dataclass

import numpy as np
import torch

from fipt.conventions import SHADING_OUTPUTS, SUB_POSITIONS
from fipt.errors import FiptError
from fipt.io.hits import Hits


@dataclass(frozen=True)
class Batch:
    """B pixels and the H hits they show (torch, float32 unless said).

    Attributes
    ----------
    radiance
        (B, 3) observed.
    valid
        (B,) weight of the pixel in [0, 1].
    clipped
        (B,) bool: the radiance is only a lower bound.
    owner
        (H,) int64 pixel of each hit, 0 to B - 1.
    weight
        (H,) share of the hit in its pixel; sums to 1 over a pixel.
    points
        (H, Q, 3) world positions to query, metres.
    footprint
        (H,) size of the pixel at the hit, metres.
    shading
        (H, 13, 3) Ld, Ls0 of every level, Ls1 of every level.
    segment
        (H,) int64 segment, 0 = unknown.
    """

    radiance: torch.Tensor
    valid: torch.Tensor
    clipped: torch.Tensor
    owner: torch.Tensor
    weight: torch.Tensor
    points: torch.Tensor
    footprint: torch.Tensor
    shading: torch.Tensor
    segment: torch.Tensor


class Pixels:
    """All training pixels that show the mesh; hits and shading stay memory-mapped.

    Parameters
    ----------
    shards
        Hits of the training shards.
    shading
        (H, 13, 3) float16 shading of each shard.
    images
        Per shard: (P, 3) radiance and (P,) weight of its pixels.
    segments
        Per shard: (P,) uint16 segment id of each pixel; None to fit without.
    clipped
        Per shard: (P,) bool, pixels whose radiance is only a lower bound; None: there are none.
    """

    def __init__(
        self,
        shards: list[Hits],
        shading: list[np.ndarray],
        images: list[tuple[np.ndarray, np.ndarray]],
        segments: list[np.ndarray] | None,
        clipped: list[np.ndarray] | None = None,
    ) -> None:
        self.shards, self.shading = shards, shading
        self.radiance = [image.astype(np.float32) for image, _ in images]
        self.clipped = clipped or [np.zeros(len(valid), bool) for _, valid in images]
        self.offsets = [np.array(shard.offsets) for shard in shards]
        for shard, shade in zip(shards, shading, strict=True):
            if shade.shape != (len(shard.position), SHADING_OUTPUTS, 3):
                raise FiptError(
                    f"shading must have shape {(len(shard.position), SHADING_OUTPUTS, 3)}; found {shade.shape}",
                    "bake this shard again",
                )
        keep, self.valid = [], []
        for number, (shard, (_, valid)) in enumerate(zip(shards, images, strict=True)):
            pixel = np.repeat(np.arange(len(valid)), np.diff(self.offsets[number]))
            covered = np.bincount(pixel, shard.weight, minlength=len(valid))
            # a pixel half off the mesh says less about the mesh
            self.valid.append((valid * np.minimum(covered, 1.0)).astype(np.float32))
            seen = np.flatnonzero(self.valid[-1] > 0)
            keep.append(np.stack([np.full(len(seen), number), seen], axis=1))
        self.index = np.concatenate(keep).astype(np.int64)
        if len(self.index) == 0:
            raise FiptError("no training pixel shows the mesh", "check poses and masks of the training views")
        self.segment = None if segments is None else _hit_segments(shards, self.offsets, segments)

    @property
    def largest_segment(self) -> int:
        """Largest segment id, 0 without segments."""
        return 0 if self.segment is None else max(int(own.max(initial=0)) for own in self.segment)

    def __len__(self) -> int:
        return len(self.index)

    def epoch_order(self, epoch: int, seed: int) -> np.ndarray:
        """Permutation of all pixels, the same for a seed and epoch wherever the fit was interrupted."""
        return np.random.default_rng([seed, epoch]).permutation(len(self.index))

    def batch(self, chosen: np.ndarray, queries: int, rng: np.random.Generator) -> Batch:
        """Gather pixels (B,) by number; each hit is queried at ``queries`` of its stored points."""
        index = self.index[chosen]
        parts: list[dict[str, np.ndarray]] = []
        start = 0
        for number in np.unique(index[:, 0]):
            pixel = index[index[:, 0] == number, 1]
            parts.append(self._of_shard(int(number), pixel, start, queries, rng))
            start += len(pixel)
        joined = {name: torch.from_numpy(np.concatenate([part[name] for part in parts])) for name in parts[0]}
        return Batch(**joined)

    def _of_shard(
        self, number: int, pixel: np.ndarray, start: int, queries: int, rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        shard, offsets = self.shards[number], self.offsets[number]
        first, count = offsets[pixel], offsets[pixel + 1] - offsets[pixel]
        owner = np.repeat(np.arange(len(pixel)), count)
        hit = np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(owner))
        weight = shard.weight[hit]
        weight = weight / np.bincount(owner, weight, minlength=len(pixel))[owner]
        turn = rng.integers(0, SUB_POSITIONS, len(hit))
        picks = (turn[:, None] + np.arange(queries) * SUB_POSITIONS // queries) % SUB_POSITIONS
        points = shard.position[hit][:, None] + shard.sub[hit[:, None], picks].astype(np.float32)
        segment = np.zeros(len(hit), np.int64) if self.segment is None else self.segment[number][hit].astype(np.int64)
        return {
            "radiance": self.radiance[number][pixel],
            "valid": self.valid[number][pixel],
            "clipped": self.clipped[number][pixel],
            "owner": owner + start,
            "weight": weight.astype(np.float32),
            "points": points,
            "footprint": np.asarray(shard.footprint[hit]),
            "shading": self.shading[number][hit].astype(np.float32),
            "segment": segment,
        }


def _hit_segments(shards: list[Hits], offsets: list[np.ndarray], segments: list[np.ndarray]) -> list[np.ndarray]:
    """(H,) uint16 segment of every hit: its pixel's where the hit is the pixel's centre, else its triangle's.

    An id map knows pixel centres only; the pieces beside the centre take the id most centres give their triangle.
    """
    triangles, ids = [], []
    for shard, offset, segment in zip(shards, offsets, segments, strict=True):
        centered = np.flatnonzero(np.asarray(shard.center) & (segment > 0))
        triangles.append(shard.triangle[offset[centered]])
        ids.append(segment[centered])
    pairs, votes = np.unique(np.stack([np.concatenate(triangles), np.concatenate(ids)]), axis=1, return_counts=True)
    order = np.lexsort((votes, pairs[0]))
    winner = np.zeros(max(int(shard.triangle.max(initial=0)) for shard in shards) + 1, np.uint16)
    winner[pairs[0][order]] = pairs[1][order]  # the last write, with the most votes, stays
    result = []
    for shard, offset, segment in zip(shards, offsets, segments, strict=True):
        own = winner[shard.triangle]
        centered = np.flatnonzero(np.asarray(shard.center))
        own[offset[centered]] = segment[centered]
        result.append(own)
    return result
