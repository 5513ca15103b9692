"""How well the photographs determine each piece of surface, before anything is fitted to them.

A piece is what one voxel holds of a surface that faces one way. It gets two numbers in [0, 1].

``views``: how far off its base colour may be. Under the baked shading every pixel tells an albedo by itself; they
differ by texture, wrong shading and highlights. With a relative spread v over the pixels of a piece, and n views
(one that sees it at an angle counts by its cosine, one of which a pixel has only a share by that share),

    sigma = albedo * sqrt((v0^2 + v^2) / n),      views = 1 / (1 + (sigma / sigma0)^2)

``highlights``: how much another roughness would change what the views show. A smooth surface reflects other light
than a matte one, by a ratio that depends on pixel and view. What is common to a piece looks like another base colour;
only the variation of the ratio within a piece, d, tells them apart:

    highlights = 1 - exp(-n d / d0)
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_LEVELS
from fipt.scene.confidence import Confidence, records
from fipt.scene.samples import FootprintSamples, scene_box
from fipt.scene.shading import Shading, brightest_reflection

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


def measure(
    shards: list[FootprintSamples],
    shading: Sequence[Shading | np.ndarray],
    images: list[tuple[np.ndarray, np.ndarray]],
    clipped: list[np.ndarray],
    eyes: Mapping[str, np.ndarray],
    lamp_gain: float,
) -> Confidence:
    """Judge all surface that the training views see; one view is held in memory at a time.

    Parameters
    ----------
    shading
        (H, outputs, 3) of each shard.
    images
        Per shard: (P, 3) radiance and (P,) weight.
    clipped
        Per shard: (P,) bool, pixels whose radiance is only a lower bound: they tell nothing.
    eyes
        (3,) position of the camera of each view, metres.
    lamp_gain
        Pixels this much brighter than any reflection are lamps; they say nothing of reflectance.
    """
    center, side = scene_box(shards)
    resolution = _resolution(shards, side)
    keys, sums = [], []
    for samples, baked, (image, valid), above in zip(shards, shading, images, clipped, strict=True):
        for index, view in enumerate(samples.views):
            own = samples.of_view(index)
            position, normal = np.asarray(samples.position[own]), np.asarray(samples.normal[own])
            pixel = samples.pixels(index).start + samples.pixel_of_sample(index)
            key, piece = np.unique(records(position, normal, center, side, resolution), return_inverse=True)
            seen = np.asarray(samples.weight[own]) * valid[pixel] * ~above[pixel]
            told = _told(image[pixel], np.asarray(baked[own], np.float32), seen, lamp_gain)
            toward = eyes[view] - position
            cosine = (toward * normal).sum(axis=1) / np.linalg.norm(toward, axis=1).clip(1e-9)
            told = np.column_stack([told, told[:, 0] * cosine.clip(0, 1)])
            keys.append(key)
            sums.append(np.stack([np.bincount(piece, column, len(key)) for column in told.T], axis=1))
            sums[-1][:, -1] = np.minimum(sums[-1][:, -1], 1)
    record, piece = np.unique(np.concatenate(keys), return_inverse=True)
    told = np.concatenate(sums)
    total = np.stack([np.bincount(piece.reshape(-1), column, len(record)) for column in told.T], axis=1)
    views, highlights = _judged(total)
    return Confidence(center, side, resolution, record, views, highlights)


def _resolution(shards: list[FootprintSamples], side: float) -> int:
    """Voxels along the box such that a pixel's footprint is about half a voxel."""
    total = count = 0.0
    for samples in shards:
        for index in range(len(samples.views)):
            own = samples.of_view(index)
            total += float(np.sum(samples.footprint[own], dtype=np.float64))
            count += own.stop - own.start
    return int(np.clip(side / (2 * total / count), 8, _FINEST))


def _told(radiance: np.ndarray, shading: np.ndarray, seen: np.ndarray, lamp_gain: float) -> np.ndarray:
    """(N, C) what each hit adds to the sums of its piece: weight, log albedo and its square, log ratios and theirs."""
    weight = np.where(_lamps(radiance, shading, lamp_gain), 0.0, seen)
    light = shading.mean(axis=2)
    specular = F0_DIELECTRIC * light[:, 1 : 1 + _LEVELS] + light[:, 1 + _LEVELS :]
    albedo = np.log((radiance.mean(axis=1) + _DARK) / (light[:, 0] + specular[:, -1] + _DARK))
    diffuse = _GREY * light[:, :1] + _DARK
    ratio = np.log((diffuse + specular[:, :-1]) / (diffuse + specular[:, -1:]))
    terms = np.column_stack([albedo, ratio])
    return np.column_stack([weight, weight[:, None] * terms, weight[:, None] * terms**2])


def _judged(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Views and highlights (K,) float32 of sums (K, C) over a piece: those of `_told`, then the number of views."""
    weight, count = total[:, :1], total[:, -1]
    mean, square = np.split(total[:, 1:-1] / np.maximum(weight, 1e-9), 2, axis=1)
    variance = np.maximum(square - mean**2, 0)
    albedo = np.minimum(np.exp(mean[:, 0]), 1)
    sigma = albedo**2 * (_SPREAD**2 + variance[:, 0]) / np.maximum(count, 1e-9)
    views = np.where(count > 0, 1 / (1 + sigma / _SIGMA**2), 0)
    change = np.sqrt(variance[:, 1:].max(axis=1))
    highlights = 1 - np.exp(-count * change / _CONTRAST)
    return views.astype(np.float32), highlights.astype(np.float32)


def of_pixels(
    samples: FootprintSamples,
    shading: Shading | np.ndarray,
    radiance: np.ndarray,
    confidence: Confidence,
    lamp_gain: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) float32 combined confidence in what each pixel of a shard shows, and (P,) bool whether that is a lamp."""
    result, shines = np.zeros(len(radiance), np.float32), np.zeros(len(radiance), bool)
    for index in range(len(samples.views)):
        own, pixels = samples.of_view(index), samples.pixels(index)
        pixel = samples.pixel_of_sample(index)
        sure = confidence.at(samples.position[own], samples.normal[own], confidence.combined)
        lamp = _lamps(radiance[pixels][pixel], np.asarray(shading[own], np.float32), lamp_gain)
        share, count = np.asarray(samples.weight[own]), pixels.stop - pixels.start
        total = np.bincount(pixel, share * sure, count)
        result[pixels] = total / np.maximum(np.bincount(pixel, share, count), 1e-9)
        shines[pixels] = np.bincount(pixel, lamp, count) > 0
    return result, shines


def _lamps(radiance: np.ndarray, shading: np.ndarray, gain: float) -> np.ndarray:
    """(N,) bool: samples whose pixel (N, 3) is ``gain`` times brighter than any reflection would be."""
    return radiance.mean(axis=1) > gain * (brightest_reflection(shading) + 1e-4)
