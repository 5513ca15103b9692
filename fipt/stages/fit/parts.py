"""Roughness, metallic and colour of whole parts, found by how well they explain what several views see.

For given roughness s and metallic m a pixel's radiance is linear in the base colour a:

    C = (1 - m) a Ld + (0.04 (1 - m) + m a) Ls0(s) + Ls1(s) = alpha + beta a

All pixels of one small piece of a part share a, whose best value is a weighted mean. What is left over measures the
pair (s, m): a highlight that moves with the view, or a reflection, cannot be explained by a wrong one. The pair is
searched on a grid, so that the fit cannot get caught between matte metal and matte dielectric, which look the same.

Then each view tells the base colour of each piece by itself. What two views agree on, beyond the mean of all looks, is
texture: its variance t^2 is their mean product (covariance). What they do not agree on is error of the shading, with
variance e^2. Where e^2 / t^2 is large, the part is better taken for uniform than read from the pictures.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.formats.images import srgb_encode
from fipt.scene.shading import brightest_reflection
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.fit.batches import Pixels
from fipt.stages.fit.settings import FitSettings

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
_LEAST_TRUST = 1e-4
"""Weight of pixels that nothing is known about: they decide only where there are no others."""
_OUTLIER = 0.2
"""Residuals count up to here (sRGB-encoded): edges and shadows that the shading misses."""
_FINE = 256
"""Pieces along the scene box in which views are compared: about the size of pixels."""
_FINEST_TEXTURE = 0.01
"""Smallest standard deviation of base colour that is taken for texture."""
_MOST_UNIFORM = 8.0
_OFF = 0.4
"""Base colours further than this from the part's mean count as this far."""
_FEWEST_WITNESSES = 3
"""Parts of a semantic class that must claim the same roughness before the others are believed to have it."""
_AGREE = 0.1
"""Standard deviation of roughness up to which they claim the same."""
_FEWEST_PAIRS = 5
"""Pieces that two views must share before texture is judged."""


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
        (S,) int64 pixels that one hit of the segment fills.
    base_color
        (S, 3) float32 median of the part.
    uniform
        (S,) float32 from 0 (textured, or not known) to 8: how much rather the part has one colour, see `_uniform`.
    """

    roughness: np.ndarray
    metallic: np.ndarray
    gain: np.ndarray
    pixels: np.ndarray
    base_color: np.ndarray
    uniform: np.ndarray


@dataclass(frozen=True)
class PartTargets:
    """What the surface of each segment is drawn to: torch, float32, a row a segment (or a hit).

    Attributes
    ----------
    roughness, metallic, pull
        (S,) the two goals, and the weight of drawing to them.
    base_color, uniform
        (S, 3) and (S,) the colour, and how much rather the segment has but one.
    """

    roughness: torch.Tensor
    metallic: torch.Tensor
    pull: torch.Tensor
    base_color: torch.Tensor
    uniform: torch.Tensor

    def of(self, segment: torch.Tensor) -> "PartTargets":
        """Rows of segments (N,) int64."""
        return PartTargets(*(values[segment] for values in vars(self).values()))


@dataclass(frozen=True)
class _Sample:
    """N pixels that one hit fills: radiance, place, normal (N, 3), shading (N, outputs, 3), segment, view (N,)."""

    radiance: np.ndarray
    shading: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    segment: np.ndarray
    view: np.ndarray


def part_targets(found: PartEstimates, settings: FitSettings) -> PartTargets:
    """Goals of every segment.

    The pull grows with what the search explained; what has no segment is drawn to matte, as by the diffuse prior.
    """
    pull = settings.target_weight * (1 + _TRUST * np.maximum(found.gain, 0))
    pull[0] = settings.diffuse_weight
    goals = (found.roughness, found.metallic, pull, found.base_color, found.uniform)
    return PartTargets(*(torch.from_numpy(values.astype(np.float32)) for values in goals))


def part_classes(pairs: Iterable[tuple[np.ndarray, np.ndarray]], count: int) -> np.ndarray:
    """(S,) semantic class of every part, 0 = unknown: the one that most of its pixels have.

    Parameters
    ----------
    pairs
        Part ids and semantic ids of each view, of one shape.
    count
        S, the largest part id and one.
    """
    codes = [np.unique(part.astype(np.int64) << 16 | other, return_counts=True) for part, other in pairs]
    code, place = np.unique(np.concatenate([code for code, _ in codes]), return_inverse=True)
    votes = np.bincount(place.reshape(-1), np.concatenate([votes for _, votes in codes]))
    order = np.argsort(votes, kind="stable")
    result = np.zeros(count, np.int64)
    known = order[(code[order] >> 16) < count]
    result[code[known] >> 16] = code[known] & 0xFFFF  # the last write, with the most votes, stays
    result[0] = 0  # what has no part has no class
    return result


def estimate_parts(
    pixels: Pixels, center: np.ndarray, side: float, lamp_gain: float, classes: np.ndarray | None = None
) -> PartEstimates:
    """Search roughness and metallic of every segment, and judge whether it has one colour.

    A part whose own pixels speak for nothing but matte takes what the other parts of its semantic class agree on.

    Parameters
    ----------
    center, side
        The scene box, metres.
    lamp_gain
        Pixels this much brighter than any reflection are lamps and left out.
    classes
        (S,) semantic class of every segment, 0 = unknown; None: parts stand alone.
    """
    sample = _inner_pixels(pixels, lamp_gain)
    count = int(pixels.largest_segment) + 1
    piece, pieces = _pieces(sample, _RESOLUTION, center, side)
    shared = np.bincount(piece, minlength=pieces)[piece] >= _FEWEST
    used = np.bincount(sample.segment, shared, count)
    trust = shared * np.maximum(pixels.confidence_at(sample.place, sample.normal), _LEAST_TRUST)
    trusted = np.maximum(np.bincount(sample.segment, trust, count), 1e-9)
    residual = np.empty((len(_METALLIC), len(_ROUGHNESS), count))
    for i, m in enumerate(_METALLIC):
        for j, s in enumerate(_ROUGHNESS):
            error = _residual(sample, piece, pieces, s, m)
            residual[i, j] = np.bincount(sample.segment, error * trust, count) / trusted
    roughness, metallic, gain = _chosen(residual, used)
    if classes is not None:
        roughness, metallic, gain = _of_classes((roughness, metallic, gain), used, classes)
    alpha, beta = _linear(sample.shading, roughness[sample.segment], metallic[sample.segment])
    base = np.clip(_best_base(sample.radiance, alpha, beta, piece, pieces), 0, 1)
    color = _medians(base, sample.segment, piece, count)
    fine, fines = _pieces(sample, _FINE, center, side)
    uniform = _uniform(sample, alpha, beta, fine, fines, color)
    seen = np.bincount(sample.segment, minlength=count)
    estimates = (roughness, metallic, gain, seen, color, uniform)
    return PartEstimates(*(x if x.dtype == np.int64 else x.astype(np.float32) for x in estimates))


def _inner_pixels(pixels: Pixels, lamp_gain: float) -> _Sample:
    """Pixels that one hit of a known segment fills, lamps left out."""
    step = max(len(pixels) // _MOST_PIXELS, 1)
    parts, passed, views = [], 0, 0
    for number, shard in enumerate(pixels.shards):
        use = (pixels.valid[number] > 0.99) & ~pixels.clipped[number]
        single = np.flatnonzero((np.diff(shard.offsets) == 1) & use)
        chosen = single[-passed % step :: step]  # the same ones however the views are spread over shards
        passed += len(single)
        first_view, views = views, views + len(shard.views)
        if len(chosen) == 0:
            continue
        hit = np.asarray(shard.offsets[chosen])
        radiance = np.asarray(pixels.radiance[number][chosen], np.float32)
        shading = pixels.shading[number][hit].astype(np.float32, copy=False)
        segment = pixels.segment_of(np.full(len(hit), number), chosen, hit)
        view = first_view + np.searchsorted(shard.first_pixels, chosen, side="right") - 1
        keep = (radiance.mean(axis=1) < lamp_gain * (brightest_reflection(shading) + 1e-4)) & (segment > 0)
        arrays = (radiance, shading, shard.position[hit], shard.normal[hit], segment, view)
        parts.append([array[keep] for array in arrays])
    if not parts:
        rows, ids = np.zeros((0, 3), np.float32), np.zeros(0, np.int64)
        return _Sample(rows, np.zeros((0, SHADING_OUTPUTS, 3), np.float32), rows, rows, ids, ids)
    return _Sample(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _pieces(sample: _Sample, resolution: int, center: np.ndarray, side: float) -> tuple[np.ndarray, int]:
    """(N,) piece of each pixel: voxel, segment and the axis its normal is nearest to; and their number."""
    record = voxel_keys(sample.place, center, side, resolution) * FACINGS + facings(sample.normal)
    _, piece = np.unique(record * 65536 + sample.segment, return_inverse=True)
    return piece.reshape(-1), int(piece.max(initial=-1)) + 1


def _linear(shading: np.ndarray, s: float | np.ndarray, m: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Alpha and beta (N, 3) of C = alpha + beta a, for roughness and metallic that are numbers or (N,)."""
    levels = np.array(ROUGHNESS_LEVELS)
    low = np.clip(np.searchsorted(levels, s, side="right") - 1, 0, len(levels) - 2)
    t = (s - levels[low]) / (levels[low + 1] - levels[low])
    rows = slice(None)
    if np.ndim(s):
        rows, t, m = np.arange(len(shading)), t[:, None], np.asarray(m)[:, None]

    def at(first: int) -> np.ndarray:
        return shading[rows, first + low] * (1 - t) + shading[rows, first + low + 1] * t

    ls0, ls1 = at(1), at(1 + len(levels))
    return F0_DIELECTRIC * (1 - m) * ls0 + ls1, (1 - m) * shading[:, 0] + m * ls0


def _best_base(radiance: np.ndarray, alpha: np.ndarray, beta: np.ndarray, group: np.ndarray, groups: int) -> np.ndarray:
    """(G, 3) base colour that explains the pixels of each group best, not clipped."""
    weight = (radiance + 0.05) ** -1.2  # about the squared slope of the sRGB curve
    base = np.empty((groups, 3))
    for c in range(3):
        w = weight[:, c] * beta[:, c]
        over = np.bincount(group, w * (radiance[:, c] - alpha[:, c]), groups)
        base[:, c] = over / np.maximum(np.bincount(group, w * beta[:, c], groups), 1e-9)
    return base


def _residual(sample: _Sample, piece: np.ndarray, pieces: int, s: float, m: float) -> np.ndarray:
    """(N,) mean absolute difference of sRGB-encoded radiance with the best base colour of each piece."""
    alpha, beta = _linear(sample.shading, s, m)
    base = np.clip(_best_base(sample.radiance, alpha, beta, piece, pieces), 0, 1)
    modelled = alpha + beta * base[piece]
    return np.minimum(np.abs(srgb_encode(modelled) - srgb_encode(sample.radiance)).mean(axis=1), _OUTLIER)


def _chosen(residual: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roughness, metallic and gain (S,) from residuals (metallic, roughness, S); cautious where little is gained."""
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
    return (
        np.where(known, rough[choice], 1.0),
        np.where(known, np.array(_METALLIC)[metal], 0.0),
        np.where(known, 1 - best / np.maximum(matte, 1e-9), 0.0),
    )


def _of_classes(
    own: tuple[np.ndarray, np.ndarray, np.ndarray], used: np.ndarray, classes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates (S,) where parts that claim nothing have those of their semantic class.

    A class speaks where it is one material: several of its parts, with most of its pixels, claim nearly the same.
    """
    roughness, metallic, gain = (values.copy() for values in own)
    claims = (own[0] < 1) | (own[1] > 0)
    for k in np.unique(classes[classes > 0]):
        told, silent = (classes == k) & claims & (used > 0), (classes == k) & ~claims
        agree = (
            np.count_nonzero(told) >= _FEWEST_WITNESSES and np.ptp(own[1][told]) == 0 and own[0][told].std() <= _AGREE
        )
        if agree and used[told].sum() >= used[silent].sum():
            for values, mine in zip((roughness, metallic, gain), own, strict=True):
                values[silent] = np.average(mine[told], weights=used[told])
    return roughness, metallic, gain


def _medians(base: np.ndarray, segment: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """(S, 3) median over the pieces (G, 3) of every segment, those with enough pixels first; grey without any."""
    owner = np.zeros(len(base), np.int64)
    owner[piece] = segment
    enough = np.bincount(piece, minlength=len(base)) >= _FEWEST
    result = np.full((count, 3), 0.5)
    for k in np.unique(segment):
        own = owner == k
        result[k] = np.median(base[own & enough if (own & enough).any() else own], axis=0)
    return result


def _uniform(
    sample: _Sample, alpha: np.ndarray, beta: np.ndarray, fine: np.ndarray, fines: int, color: np.ndarray
) -> np.ndarray:
    """(S,) e^2 / (t^2 n) - 1 where that is positive: error over texture of base colours, with n views a piece.

    A pull of this strength weighs the part's mean against n noisy looks as their variances do (empirical Bayes).
    """
    count = len(color)
    looks, look = np.unique(fine * (int(sample.view.max(initial=0)) + 1) + sample.view, return_inverse=True)
    piece, segment = np.zeros(len(looks), np.int64), np.zeros(len(looks), np.int64)
    piece[look], segment[look] = fine, sample.segment
    base = _best_base(sample.radiance, alpha, beta, look, len(looks))
    off = np.clip(base - color[segment], -_OFF, _OFF)
    number = np.maximum(np.bincount(segment, minlength=count), 1)
    # the looks' own mean, not the median: an error that all looks share is no texture
    off -= np.stack([np.bincount(segment, o, count) / number for o in off.T], axis=1)[segment]
    views = np.bincount(piece, minlength=fines)
    owner = np.zeros(fines, np.int64)
    owner[piece] = segment
    pairs = views * (views - 1.0)
    together = sum(np.bincount(piece, o, fines) ** 2 - np.bincount(piece, o**2, fines) for o in off.T) / 3
    texture = np.bincount(owner, together, count) / np.maximum(np.bincount(owner, pairs, count), 1)
    total = np.bincount(segment, (off**2).mean(axis=1), count) / number
    mean_views = np.bincount(owner, views, count) / np.maximum(np.bincount(owner, minlength=count), 1)
    texture = np.maximum(texture, 0)
    ratio = np.maximum(total - texture, 0) / (texture + _FINEST_TEXTURE**2) / np.maximum(mean_views, 1)
    known = np.bincount(owner, pairs > 0, count) >= _FEWEST_PAIRS
    return np.where(known, np.clip(ratio - 1, 0, _MOST_UNIFORM), 0.0)
