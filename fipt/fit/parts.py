"""Roughness and metallic of whole parts, found by how well they explain what several views see.

For given roughness s and metallic m a pixel's radiance is linear in the base colour a:

    C = (1 - m) a Ld + (0.04 (1 - m) + m a) Ls0(s) + Ls1(s) = alpha + beta a

All pixels of one small piece of a part share a, whose best value is a weighted mean. What is left over measures the
pair (s, m): a highlight that moves with the view, or a reflection, cannot be explained by a wrong one. The pair is
searched on a grid, so that the fit cannot get caught between matte metal and matte dielectric, which look the same.
"""

from dataclasses import dataclass

import numpy as np

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_LEVELS, ROUGHNESS_MIN
from fipt.fit.batches import Pixels
from fipt.io.images import srgb_encode
from fipt.settings import Fit

_ROUGHNESS = (0.02, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_METALLIC = (0.0, 0.5, 0.75, 1.0)
_MOST_PIXELS = 400_000
"""Pixels used at most: a part's two numbers do not need more."""
_RESOLUTION = 96
"""Pieces along the scene box that share one base colour."""
_FEWEST = 4
"""Pixels that a piece must have; with fewer the base colour explains anything."""
_METAL_GAIN = 0.1
"""Share of the residual that metal must remove before it is believed."""
_CAUTION = 0.5
"""Smoothness must remove more than this / sqrt(pixels) of the residual; matte otherwise."""
_TRUST = 20.0
"""How much the pull of a part grows with the share of the residual that its estimate removes."""
_OUTLIER = 0.2
"""Residuals count up to here (sRGB-encoded): edges and shadows that the shading misses."""


@dataclass(frozen=True)
class PartEstimates:
    """Estimates by segment id.

    Attributes
    ----------
    roughness, metallic
        (S,) float32; 1 and 0 where nothing is known.
    gain
        (S,) float32 share of the matte residual that the estimate removes.
    pixels
        (S,) int64 pixels used.
    """

    roughness: np.ndarray
    metallic: np.ndarray
    gain: np.ndarray
    pixels: np.ndarray


def part_targets(found: PartEstimates, settings: Fit) -> np.ndarray:
    """(S, 3) float32 of every segment: roughness and metallic to draw it to, and the weight of doing so.

    The weight grows with what the search explained; what has no segment is drawn to matte, as by the diffuse prior.
    """
    weight = settings.target_weight * (1 + _TRUST * np.maximum(found.gain, 0))
    weight[0] = settings.diffuse_weight
    return np.stack([found.roughness, found.metallic, weight], axis=1).astype(np.float32)


def estimate_parts(pixels: Pixels, center: np.ndarray, side: float, lamp_gain: float) -> PartEstimates:
    """Search roughness and metallic of every segment.

    Parameters
    ----------
    center, side
        The scene box, metres.
    lamp_gain
        Pixels this much brighter than any reflection are lamps and left out.
    """
    radiance, shading, place, normal, segment = _inner_pixels(pixels)
    mirror = (shading[:, 1 : 1 + len(ROUGHNESS_LEVELS)] + shading[:, 1 + len(ROUGHNESS_LEVELS) :]).max(axis=1)
    most = np.maximum(shading[:, 0], mirror).mean(axis=1)
    keep = (radiance.mean(axis=1) < lamp_gain * (most + 1e-4)) & (segment > 0)
    radiance, shading, segment = radiance[keep], shading[keep], segment[keep]
    count = int(pixels.largest_segment) + 1
    piece, pieces = _pieces(place[keep], normal[keep], segment, center, side)
    shared = np.bincount(piece, minlength=pieces)[piece] >= _FEWEST
    used = np.bincount(segment, shared, count)
    residual = np.empty((len(_METALLIC), len(_ROUGHNESS), count))
    for i, m in enumerate(_METALLIC):
        for j, s in enumerate(_ROUGHNESS):
            error = _residual(radiance, shading, piece, pieces, s, m)
            residual[i, j] = np.bincount(segment, error * shared, count) / np.maximum(used, 1)
    return _chosen(residual, used)


def _inner_pixels(pixels: Pixels) -> tuple[np.ndarray, ...]:
    """Pixels that one hit fills: radiance (N, 3), shading (N, 13, 3), position, normal (N, 3), segment (N,)."""
    step = max(len(pixels) // _MOST_PIXELS, 1)
    parts = []
    for number, shard in enumerate(pixels.shards):
        offsets = pixels.offsets[number]
        single = (np.diff(offsets) == 1) & (pixels.valid[number] > 0.99) & ~pixels.clipped[number]
        chosen = np.flatnonzero(single)[::step]
        hit = offsets[chosen]
        parts.append(
            (
                pixels.radiance[number][chosen],
                pixels.shading[number][hit].astype(np.float32),
                shard.position[hit],
                shard.normal[hit],
                pixels.segment[number][hit].astype(np.int64),
            )
        )
    return tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


def _pieces(
    place: np.ndarray, normal: np.ndarray, segment: np.ndarray, center: np.ndarray, side: float
) -> tuple[np.ndarray, int]:
    """(N,) piece of each pixel: voxel, segment and the axis its normal is nearest to; and their number."""
    cell = np.floor((place - (center - side / 2)) * (_RESOLUTION / side)).clip(0, _RESOLUTION - 1).astype(np.int64)
    axis = np.abs(normal).argmax(axis=1)
    facing = 2 * axis + (normal[np.arange(len(axis)), axis] > 0)
    voxel = cell @ np.array([1, _RESOLUTION, _RESOLUTION**2])
    _, piece = np.unique((voxel * 6 + facing) * 65536 + segment, return_inverse=True)
    return piece.reshape(-1), int(piece.max(initial=-1)) + 1


def _residual(
    radiance: np.ndarray, shading: np.ndarray, piece: np.ndarray, pieces: int, s: float, m: float
) -> np.ndarray:
    """(N,) mean absolute difference of sRGB-encoded radiance with the best base colour of each piece."""
    levels = len(ROUGHNESS_LEVELS)
    x = (s - ROUGHNESS_MIN) / (1 - ROUGHNESS_MIN) * (levels - 1)
    low = min(int(x), levels - 2)
    t = x - low
    ls0 = shading[:, 1 + low] * (1 - t) + shading[:, 2 + low] * t
    ls1 = shading[:, 1 + levels + low] * (1 - t) + shading[:, 2 + levels + low] * t
    alpha = F0_DIELECTRIC * (1 - m) * ls0 + ls1
    beta = (1 - m) * shading[:, 0] + m * ls0
    weight = (radiance + 0.05) ** -1.2  # about the squared slope of the sRGB curve
    base = np.empty((pieces, 3))
    for c in range(3):
        w = weight[:, c] * beta[:, c]
        over = np.bincount(piece, w * (radiance[:, c] - alpha[:, c]), pieces)
        base[:, c] = over / np.maximum(np.bincount(piece, w * beta[:, c], pieces), 1e-9)
    modelled = alpha + beta * np.clip(base, 0, 1)[piece]
    return np.minimum(np.abs(srgb_encode(modelled) - srgb_encode(radiance)).mean(axis=1), _OUTLIER)


def _chosen(residual: np.ndarray, used: np.ndarray) -> PartEstimates:
    """Choose (s, m) from residuals (metallic, roughness, S); cautious where little is gained."""
    rough = np.array(_ROUGHNESS)
    caution = _CAUTION / np.sqrt(np.maximum(used, 1))
    cautious = residual * (1 + caution * (1 - rough)[None, :, None])
    per_metal = cautious.min(axis=1)
    metal = per_metal.argmin(axis=0)
    segments = np.arange(residual.shape[2])
    believed = per_metal[metal, segments] < (1 - _METAL_GAIN - caution) * per_metal[0]
    metal = np.where(believed, metal, 0)
    choice = cautious[metal, :, segments].argmin(axis=1)
    matte = residual[0, -1]
    best = residual[metal, choice, segments]
    known = used >= _FEWEST
    return PartEstimates(
        roughness=np.where(known, rough[choice], 1.0).astype(np.float32),
        metallic=np.where(known, np.array(_METALLIC)[metal], 0.0).astype(np.float32),
        gain=np.where(known, 1 - best / np.maximum(matte, 1e-9), 0.0).astype(np.float32),
        pixels=used.astype(np.int64),
    )
