"""Training data of the fit: pixels, the surface pieces they show, baked shading and segment ids."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from fipt.conventions import SHADING_OUTPUTS, SUB_POSITIONS
from fipt.errors import FiptError
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import Empty, FootprintSamples, segments_of_triangles
from fipt.scene.shading import Shading
from fipt.stages.fit.evidence import PhotoEvidence
from fipt.stages.fit.light_errors import LightErrors

_BLOCK = 1 << 20
"""Pixels looked at together."""


@dataclass(frozen=True)
class Batch:
    """B pixels and the H samples they show (torch, float32 unless said).

    Attributes
    ----------
    radiance
        (B, 3) observed.
    valid
        (B,) weight of the pixel in [0, 1].
    clipped
        (B,) bool: the radiance is only a lower bound.
    owner
        (H,) int64 pixel of each sample, 0 to B - 1.
    weight
        (H,) share of the sample in its pixel; sums to ``share`` over a pixel.
    points
        (H, Q, 3) world positions to query, metres, the inset of the field below the surface.
    footprint
        (H,) size of the pixel at the sample, metres.
    shading
        (H, outputs, 3) Ld, Ls0 of every level, Ls1 of every level.
    segment
        (H,) int64 segment, 0 = unknown.
    confidence
        (H,) in [0, 1]: how well the photographs determine the surface there; 1 where that is not asked for.
    beyond
        (B, 3) radiance from outside in pixels at the edge of an opening, times the share it fills; 0 elsewhere. None
        where the scene has no opening.
    share
        (B,) share of the pixel that the samples explain: 1 but for those at the edge of an opening. None likewise.
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
    confidence: torch.Tensor
    beyond: torch.Tensor | None = None
    share: torch.Tensor | None = None

    @property
    def on_mesh(self) -> torch.Tensor:
        """(B, 3) observed radiance of the part of each pixel that shows the mesh."""
        if self.beyond is None or self.share is None:
            return self.radiance
        return ((self.radiance - self.beyond) / self.share[:, None]).clamp_min(0)

    def to(self, device: torch.device) -> "Batch":
        """The same on a device."""
        there = {name: values.to(device) for name, values in vars(self).items() if values is not None}
        return replace(self, **there)


class Pixels:
    """All training pixels that show the mesh; what grows with the views can stay on disk.

    Parameters
    ----------
    shards
        The training views.
    segments
        Per shard: (P,) uint16 segment id of each pixel; None to fit without.
    confidence
        Of the surface; None to trust all of it alike.
    beyond
        Per shard: pixels (K,) that show the outside too, and what it adds to them (K, 3); see `fipt.scene.environment`.
    empty
        Makes the arrays over all pixels: in memory, or `fipt.formats.arrays.on_disk`.
    inset
        Metres below the surface at which the field is asked.

    Attributes
    ----------
    light
        Errors of the traced light, which batches are without; None until they are known.
    """

    def __init__(
        self,
        shards: Sequence[ObservedShard],
        segments: list[np.ndarray] | None = None,
        confidence: PhotoEvidence | None = None,
        beyond: list[tuple[np.ndarray, np.ndarray]] | None = None,
        empty: Empty = np.empty,
        inset: float = 0.0,
    ) -> None:
        self.inset = inset
        self.shards, self.shading = [shard.samples for shard in shards], [shard.shading for shard in shards]
        self.confidence = confidence
        self.beyond = beyond if beyond is not None and any(len(pixel) for pixel, _ in beyond) else None
        self.radiance, self.clipped = [shard.radiance for shard in shards], [shard.clipped for shard in shards]
        for shard in shards:
            if shard.shading.shape != (len(shard.samples.position), SHADING_OUTPUTS, 3):
                raise FiptError(
                    f"shading must have shape {(len(shard.samples.position), SHADING_OUTPUTS, 3)}; "
                    f"found {shard.shading.shape}",
                    "bake this shard again",
                )
        self.valid = [_visible(shard.samples, shard.weight, empty) for shard in shards]
        counts = [len(valid) for valid in self.valid]
        self._starts = np.concatenate([[0], np.cumsum(counts)])
        seen = [np.count_nonzero(valid) for valid in self.valid]
        self.index = empty((sum(seen),), np.min_scalar_type(int(self._starts[-1])))
        done = 0
        for start, valid in zip(self._starts, self.valid, strict=False):
            for first in range(0, len(valid), _BLOCK):
                found = np.flatnonzero(valid[first : first + _BLOCK]) + (start + first)
                self.index[done : done + len(found)] = found
                done += len(found)
        if len(self.index) == 0:
            raise FiptError("no training pixel shows the mesh", "check poses and masks of the training views")
        self.light: LightErrors | None = None
        self._segments = segments
        self.largest_segment, self._winner = (
            (0, None) if segments is None else segments_of_triangles(self.shards, segments)
        )

    def _below(self, position: np.ndarray, shard: np.ndarray, sample: np.ndarray) -> np.ndarray:
        """Positions (N, 3) of samples moved below the surface; their normals are read only where they are needed."""
        if self.inset == 0:
            return position
        normals = _gathered([each.normal for each in self.shards], shard, sample)
        return position - np.float32(self.inset) * normals

    def _confidence(self, shard: np.ndarray, sample: np.ndarray, position: np.ndarray) -> np.ndarray:
        """`confidence_at` of samples; their normals are read only where they are needed."""
        if self.confidence is None:
            return np.ones(len(sample), np.float32)
        return self.confidence_at(position, _gathered([each.normal for each in self.shards], shard, sample))

    def confidence_at(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) float32 confidence at surface points (N, 3) with normals (N, 3); 1 where it is not asked for."""
        known = self.confidence
        return np.ones(len(points), np.float32) if known is None else known.at(points, normals, known.combined)

    def lit(self, shading: np.ndarray, points: np.ndarray, segment: np.ndarray) -> np.ndarray:
        """Shading (N, outputs, 3) of points (N, 3) of segments (N,) without what is known of its errors."""
        return shading if self.light is None else shading * self.light.factor(points, segment)[:, None, None]

    def __len__(self) -> int:
        return len(self.index)

    def batch(self, chosen: np.ndarray, queries: int, rng: np.random.Generator) -> Batch:
        """Gather pixels (B,) by number, in their order; each sample is queried at ``queries`` of its stored points."""
        place = self.index[chosen].astype(np.int64)
        shard = np.searchsorted(self._starts, place, side="right") - 1
        pixel = place - self._starts[shard]
        offsets = [each.offsets for each in self.shards]
        first = _gathered(offsets, shard, pixel)
        count = _gathered(offsets, shard, pixel + 1) - first
        owner = np.repeat(np.arange(len(pixel)), count)
        sample = np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(owner))

        def of_samples(arrays: Sequence[Shading | np.ndarray]) -> np.ndarray:
            return _gathered(arrays, shard[owner], sample)

        weight = of_samples([each.weight for each in self.shards])
        covered = np.bincount(owner, weight, minlength=len(pixel))
        outside = {} if self.beyond is None else self._outside(self.beyond, shard, pixel, covered)
        weight = weight / (covered / outside.get("share", 1.0))[owner]
        turn = rng.integers(0, SUB_POSITIONS, len(sample))
        picks = (turn[:, None] + np.arange(queries) * SUB_POSITIONS // queries) % SUB_POSITIONS
        sub = np.take_along_axis(of_samples([each.sub for each in self.shards]), picks[..., None], axis=1)
        position = of_samples([each.position for each in self.shards])
        segment = self.segment_of(shard[owner], pixel[owner], sample)
        arrays = {
            "radiance": _gathered(self.radiance, shard, pixel).astype(np.float32),
            "valid": _gathered(self.valid, shard, pixel),
            "clipped": _gathered(self.clipped, shard, pixel),
            "owner": owner,
            "weight": weight.astype(np.float32),
            "points": self._below(position, shard[owner], sample)[:, None] + sub.astype(np.float32),
            "footprint": of_samples([each.footprint for each in self.shards]),
            "shading": self.lit(of_samples(self.shading).astype(np.float32), position, segment),
            "segment": segment,
            "confidence": self._confidence(shard[owner], sample, position),
            **outside,
        }
        return Batch(**{name: torch.from_numpy(array) for name, array in arrays.items()})

    @staticmethod
    def _outside(
        edges: list[tuple[np.ndarray, np.ndarray]], shard: np.ndarray, pixel: np.ndarray, covered: np.ndarray
    ) -> dict[str, np.ndarray]:
        """``beyond`` and ``share`` of pixels (B,) of shards (B,), of which ``covered`` (B,) is mesh."""
        share, beyond = np.ones(len(pixel), np.float32), np.zeros((len(pixel), 3), np.float32)
        for number in np.unique(shard):
            edge, radiance = edges[number]
            chosen = np.flatnonzero(shard == number)
            own, place = np.intersect1d(pixel[chosen], edge, return_indices=True)[1:]
            share[chosen[own]], beyond[chosen[own]] = covered[chosen[own]], radiance[place]
        return {"beyond": beyond, "share": share}

    def segment_of(self, shard: np.ndarray, pixel: np.ndarray, sample: np.ndarray) -> np.ndarray:
        """(N,) int64 segment of samples, given with their shards and pixels: the pixel's for its centre.

        An id map knows pixel centres only; the pieces beside the centre take the id most centres give their triangle.
        """
        if self._segments is None or self._winner is None:
            return np.zeros(len(sample), np.int64)
        first = _gathered([each.offsets for each in self.shards], shard, pixel) == sample
        center = first & (_gathered([each.center for each in self.shards], shard, pixel) > 0)
        triangle = _gathered([each.triangle for each in self.shards], shard, sample)
        return np.where(center, _gathered(self._segments, shard, pixel), self._winner[triangle]).astype(np.int64)


def shuffled(places: np.ndarray, count: int, key: list[int]) -> np.ndarray:
    """(B,) int64: what lies at ``places`` (B,) of a deck of ``count`` cards shuffled with ``key``.

    A Feistel network over the next power of four; what falls outside the deck goes round again. Nothing is stored, so
    that a fit which never sees most of its pixels does not pay for them, and a resumed one draws the same.
    """
    half = (max(count - 1, 1).bit_length() + 1) // 2
    shift, mask = np.uint64(half), np.uint64(2**half - 1)
    keys = np.random.default_rng(key).integers(0, 2**63, 6, dtype=np.uint64)
    result = places.astype(np.uint64)
    todo = np.arange(len(result))
    while len(todo):
        left, right = result[todo] >> shift, result[todo] & mask
        for own in keys:
            mixed = (right ^ own) * np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
            left, right = right, left ^ ((mixed >> np.uint64(32)) & mask)
        result[todo] = (left << shift) | right
        todo = todo[result[todo] >= count]
    return result.astype(np.int64)


def _gathered(arrays: Sequence[Shading | np.ndarray], shard: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows (N,) of the arrays of shards (N,)."""
    numbers = np.unique(shard)
    parts = [(shard == number, arrays[number]) for number in numbers]
    found = [np.asarray(array[rows[own]]) for own, array in parts]
    if len(found) == 1:
        return found[0]
    result = np.empty((len(rows), *found[0].shape[1:]), found[0].dtype)
    for (own, _), values in zip(parts, found, strict=True):
        result[own] = values
    return result


def _visible(shard: FootprintSamples, weight: np.ndarray, empty: Empty) -> np.ndarray:
    """(P,) float32 weight of every pixel; one half off the mesh says less about the mesh."""
    result = empty((len(weight),), np.float32)
    for index in range(len(shard.views)):
        own = shard.pixels(index)
        covered = np.bincount(shard.pixel_of_sample(index), shard.weight[shard.of_view(index)], own.stop - own.start)
        result[own] = weight[own] * np.minimum(covered, 1.0)
    return result
