"""What the photographs tell of each piece of surface, before anything is fitted to them.

It is what `fit.confidence_weights` and `fit.min_confidence` go by; what is off after the fit is predicted in
`fipt.stages.fit.uncertainty`.

A piece is what one voxel holds of a surface that faces one way. It gets two numbers in [0, 1].

``views``: how far off its base colour may be. Under the baked shading every pixel has an albedo by itself; they
differ by texture, wrong shading and highlights. With a relative spread v over the pixels of a piece, and n views
(one that sees it at an angle counts by its cosine, one of which a pixel has only a share by that share),

    sigma = albedo * sqrt((v0^2 + v^2) / n),      views = 1 / (1 + (sigma / sigma0)^2)

``highlights``: how much another roughness would change what the views show. A smooth surface reflects other light
than a matte one, by a ratio that depends on pixel and view. What is common to a piece looks like another base colour;
only the variation of the ratio within a piece, d, tells them apart:

    highlights = 1 - exp(-n d / d0)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.conventions import ROUGHNESS_LEVELS
from fipt.errors import FiptError
from fipt.model.reflectance import exceeds_reflection, specular_reflectance
from fipt.scene.confidence import SurfaceRecords, records
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import FootprintSamples, scene_box

_LEVELS = len(ROUGHNESS_LEVELS)
_FINEST = 96
"""Voxels along the scene box at most; fewer where pixels are coarser than that."""
_SPREAD = 0.1
"""v0: relative error of shading that all pixels of a view share."""
_SIGMA = 0.05
"""sigma0: error of the base colour at which half of the confidence is left."""
_CONTRAST = 0.05
"""d0: relative change of radiance, times views, that is a good sign of roughness."""
_GREY = 0.5
"""Base colour under which highlights are judged."""
_DARK = 1e-3
"""Radiance that counts as dark, added before ratios are taken."""


@dataclass(frozen=True)
class PhotoEvidence(SurfaceRecords):
    """What the photographs tell, by voxel and facing.

    Attributes
    ----------
    views
        (K,) float32 in [0, 1]: evidence for the base colour, from number, angle and agreement of the views.
    highlights
        (K,) float32 in [0, 1]: evidence for roughness and metallic, from the light that they would change.
    """

    views: np.ndarray
    highlights: np.ndarray

    @property
    def combined(self) -> np.ndarray:
        """(K,) the evidence for the material as a whole: half of it needs highlights, all of it views."""
        return (self.views * (0.5 + 0.5 * self.highlights)).astype(np.float32)


def measure(shards: Sequence[ObservedShard], eyes: Mapping[str, np.ndarray], emitter_gain: float) -> PhotoEvidence:
    """Judge all surface that the training views see; one view is held in memory at a time.

    Clipped pixels say nothing, nor do those that show an emitter.

    Parameters
    ----------
    shards
        The training views.
    eyes
        (3,) position of the camera of each view, metres.
    emitter_gain
        Pixels this much brighter than any reflection show an emitter.
    """
    center, side = scene_box([shard.samples for shard in shards])
    resolution = piece_resolution([shard.samples for shard in shards], side)
    keys, sums = [], []
    for shard in shards:
        samples = shard.samples
        for index, view in enumerate(samples.views):
            own = samples.of_view(index)
            position, normal = np.asarray(samples.position[own]), np.asarray(samples.normal[own])
            key, piece = np.unique(records(position, normal, center, side, resolution), return_inverse=True)
            evidence = _evidence(shard, index, emitter_gain)
            toward = eyes[view] - position
            cosine = (toward * normal).sum(axis=1) / np.linalg.norm(toward, axis=1).clip(1e-9)
            evidence = np.column_stack([evidence, evidence[:, 0] * cosine.clip(0, 1)])
            keys.append(key)
            sums.append(sums_by(piece, evidence, len(key)))
            sums[-1][:, -1] /= np.maximum(sums[-1][:, 0], 1)  # the mean cosine, less where there is less than a pixel
    record, piece = np.unique(np.concatenate(keys), return_inverse=True)
    views, highlights = _judged(sums_by(piece.reshape(-1), np.concatenate(sums), len(record)))
    return PhotoEvidence(center, side, resolution, record, views, highlights)


def sums_by(piece: np.ndarray, columns: np.ndarray, count: int) -> np.ndarray:
    """(count, C) sums of rows (N, C) over pieces (N,)."""
    return np.stack([np.bincount(piece, column, count) for column in columns.T], axis=1)


def piece_resolution(shards: Sequence[FootprintSamples], side: float) -> int:
    """Voxels along the box such that a pixel's footprint is about half a voxel."""
    total = count = 0.0
    for samples in shards:
        for index in range(len(samples.views)):
            own = samples.of_view(index)
            total += float(np.sum(samples.footprint[own], dtype=np.float64))
            count += own.stop - own.start
    return int(np.clip(side / (2 * total / count), 8, _FINEST))


def _evidence(shard: ObservedShard, index: int, emitter_gain: float) -> np.ndarray:
    """(N, C) what the samples of a view add to the sums of their pieces.

    That is their weight, and, each times the weight, the log albedo and log ratios, then the squares of those.
    """
    samples, own = shard.samples, shard.samples.of_view(index)
    pixel = samples.pixels(index).start + samples.pixel_of_sample(index)
    radiance, shading = shard.radiance[pixel], np.asarray(shard.shading[own], np.float32)
    weight = np.asarray(samples.weight[own]) * shard.weight[pixel] * ~shard.clipped[pixel]
    weight = np.where(exceeds_reflection(radiance, shading, emitter_gain), 0.0, weight)
    light = shading.mean(axis=2)
    specular = specular_reflectance(_GREY, 0.0) * light[:, 1 : 1 + _LEVELS] + light[:, 1 + _LEVELS :]
    albedo = np.log((radiance.mean(axis=1) + _DARK) / (light[:, 0] + specular[:, -1] + _DARK))
    diffuse = _GREY * light[:, :1] + _DARK
    ratio = np.log((diffuse + specular[:, :-1]) / (diffuse + specular[:, -1:]))
    terms = np.column_stack([albedo, ratio])
    return np.column_stack([weight, weight[:, None] * terms, weight[:, None] * terms**2])


def _judged(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Views and highlights (K,) float32 of sums (K, C) over a piece: those of `_evidence`, then the number of views."""
    weight, count = total[:, :1], total[:, -1]
    mean, square = np.split(total[:, 1:-1] / np.maximum(weight, 1e-9), 2, axis=1)
    variance = np.maximum(square - mean**2, 0)
    albedo = np.minimum(np.exp(mean[:, 0]), 1)
    sigma = albedo**2 * (_SPREAD**2 + variance[:, 0]) / np.maximum(count, 1e-9)
    views = np.where(count > 0, 1 / (1 + sigma / _SIGMA**2), 0)
    change = np.sqrt(variance[:, 1:].max(axis=1))
    highlights = 1 - np.exp(-count * change / _CONTRAST)
    return views.astype(np.float32), highlights.astype(np.float32)


def of_pixels(shard: ObservedShard, evidence: PhotoEvidence, emitter_gain: float) -> tuple[np.ndarray, np.ndarray]:
    """(P,) float32 combined confidence in what each pixel shows, and (P,) bool whether that is an emitter."""
    samples = shard.samples
    result, emits = np.zeros(len(shard.radiance), np.float32), np.zeros(len(shard.radiance), bool)
    for index in range(len(samples.views)):
        own, pixels = samples.of_view(index), samples.pixels(index)
        pixel = samples.pixel_of_sample(index)
        known = evidence.at(samples.position[own], samples.normal[own], evidence.combined)
        shading = np.asarray(shard.shading[own], np.float32)
        emitter = exceeds_reflection(shard.radiance[pixels][pixel], shading, emitter_gain)
        share, count = np.asarray(samples.weight[own]), pixels.stop - pixels.start
        total = np.bincount(pixel, share * known, count)
        result[pixels] = total / np.maximum(np.bincount(pixel, share, count), 1e-9)
        emits[pixels] = np.bincount(pixel, emitter, count) > 0
    return result, emits


def confident_pixels(
    shards: Sequence[ObservedShard], evidence: PhotoEvidence, least: float, emitter_gain: float
) -> list[ObservedShard]:
    """The same shards; no weight is left to pixels that show surface of less confidence than ``least``.

    Emitters keep theirs, and what is clipped may be one: they teach a mask, and nothing about reflectance.

    Raises
    ------
    FiptError
        If no pixel is left.
    """
    chosen, best = [], 0.0
    for shard in shards:
        known, emits = of_pixels(shard, evidence, emitter_gain)
        weight = np.where((known >= least) | emits | shard.clipped, shard.weight, 0)
        chosen.append(replace(shard, weight=weight))
        best = max(best, float(known[shard.weight > 0].max(initial=0)))
    if best < least:
        raise FiptError(
            f"fit.min_confidence {least} leaves no pixel of the training views; the highest confidence is {best:.3f}",
            "lower fit.min_confidence",
        )
    return chosen
