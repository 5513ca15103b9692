"""Roughness, metallic and colour of whole parts, found by how well they explain what several views see.

For given roughness s and metallic m a pixel's radiance is linear in the base colour a:

    C = (1 - m) a Ld + (0.04 (1 - m) + m a) Ls0(s) + Ls1(s) = A + B a

All pixels of one small piece of a part share a, whose best value is a weighted mean. What is left over measures the
pair (s, m): a highlight that moves with the view, or a reflection, cannot be explained by a wrong one. The pair is
searched on a grid, so that the fit cannot get caught between matte metal and matte dielectric, which appear the same.

Whether a part has one colour is judged in `fipt.stages.fit.part_colors`.
"""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch

from fipt.conventions import UNSEEN_DIFFERENCE
from fipt.formats.images import srgb_encode
from fipt.model.reflectance import line_in_base_color, line_of_lobes, specular_shading
from fipt.scene.metals import JudgedMetals
from fipt.stages.fit.batches import Pixels
from fipt.stages.fit.inner_pixels import (
    FEWEST,
    InnerPixels,
    best_base_color,
    encoded_weight,
    inner_pixels,
    pieces_of,
)
from fipt.stages.fit.light_errors import RESOLUTION, LightErrors, cells_of, measured
from fipt.stages.fit.material_posterior import posterior
from fipt.stages.fit.part_colors import FINE, median_colors, uniformity

ROUGHNESS = (0.02, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_METALLIC = (0.0, 0.5, 0.75, 1.0)
_METAL_GAIN = 0.1
"""Share of the residual that metal must remove before it is believed."""
_CAUTION = 0.5
"""Smoothness must remove more than this / sqrt(free deviations) of the residual; otherwise it is not known."""
_MOST_THREADS = 4
"""Of the search, whatever the machine has: each takes memory of its own."""
BYTES_A_SEARCHED = 250
"""Of memory, for a pixel of the search in each thread (measured 243)."""
_PAIR = 2
"""Numbers that the search finds of a part."""
_LEAST_TRUST = 1e-4
"""Weight of pixels that nothing is known about: they decide only where there are no others."""
_NO_ERROR = 1e-4
"""Residuals below this are none: a fortieth of a step of 8 bits."""
_OUTLIER = 0.2
"""Residuals count up to here (sRGB-encoded): edges and shadows that the shading misses."""
_FEWEST_WITNESSES = 3
"""Parts of a semantic class that must claim the same roughness before the others are believed to have it."""
_AGREE = 0.1
"""Standard deviation of roughness up to which they claim the same."""


@dataclass(frozen=True)
class PartEstimates:
    """Estimates by segment id.

    Attributes
    ----------
    roughness, metallic
        (S,) float32; where nothing is known the roughness to expect in the room, and 0.
    gain
        (S,) float32 share of the matte residual that the estimate removes.
    pixels
        (S,) int64 pixels that one sample of the segment fills.
    base_color
        (S, 3) float32 median of the part.
    uniform
        (S,) float32 from 0 (textured, or not known) to 8: how much rather the part has one colour
        (`fipt.stages.fit.part_colors`).
    residual
        (2, roughnesses, S) float32 residual of every roughness as dielectric and as metal.
    free
        (S,) int64 pixels that it was measured on, without one for each colour that they had of their own.
    light
        Errors of the traced light, which base colour and uniform are without; None where they were not asked for.
    """

    roughness: np.ndarray
    metallic: np.ndarray
    gain: np.ndarray
    pixels: np.ndarray
    base_color: np.ndarray
    uniform: np.ndarray
    residual: np.ndarray
    free: np.ndarray
    light: LightErrors | None


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
    pixels: Pixels,
    center: np.ndarray,
    side: float,
    emitter_gain: float,
    classes: np.ndarray | None = None,
    metals: JudgedMetals | None = None,
    light_errors: bool = False,
) -> PartEstimates:
    """Search roughness and metallic of every segment, and judge whether it has one colour.

    A part whose own pixels prove no smoothness takes what the other parts of its semantic class agree on. Where they
    do not, its roughness is the one to expect of it.

    Parameters
    ----------
    center, side
        The scene box, metres.
    emitter_gain
        Pixels this much brighter than any reflection show an emitter and are left out.
    classes
        (S,) semantic class of every segment, 0 = unknown; None: parts stand alone.
    metals
        What is known of segments: metal, unless their own pixels clearly say no; or none, whatever these say.
    light_errors
        Whether slow changes of brightness within a segment are errors of the light; not of classes, of several paints.
    """
    inner = inner_pixels(pixels, emitter_gain)
    count = int(pixels.largest_segment) + 1
    piece, pieces = pieces_of(inner, RESOLUTION, center, side)
    shared = np.bincount(piece, minlength=pieces)[piece] >= FEWEST
    used = np.bincount(inner.segment, shared, count)
    trust = shared * np.maximum(pixels.confidence_at(inner.place, inner.normal), _LEAST_TRUST)
    groups = _Pieces(inner, piece, trust, count)
    residual = np.empty((len(_METALLIC), len(ROUGHNESS), count))
    with ThreadPoolExecutor(search_threads()) as threads:
        for column, found in enumerate(threads.map(groups.residuals, ROUGHNESS)):
            residual[:, column] = found
    roughness, metallic, gain = _chosen(residual, groups.free, metals or JudgedMetals())
    if classes is not None:
        roughness, metallic, gain = _of_classes((roughness, metallic, gain), used, classes)
    roughness = _expected(roughness, metallic, residual[[0, -1]], groups.free, classes)
    light = _light_errors(inner, roughness, metallic, center, side) if light_errors else None
    if light is not None:
        inner = replace(inner, shading=inner.shading * light.factor(inner.place, inner.segment)[:, None, None])
    offset, slope = line_in_base_color(inner.shading, roughness[inner.segment], metallic[inner.segment])
    base = np.clip(best_base_color(inner.radiance, offset, slope, piece, pieces), 0, 1)
    color = median_colors(base, inner.segment, piece, count)
    fine, fines = pieces_of(inner, FINE, center, side)
    uniform = uniformity(inner, offset, slope, fine, fines, color)
    seen = np.bincount(inner.segment, minlength=count)
    free = np.maximum(groups.free, 0).astype(np.int64)
    estimates = (roughness, metallic, gain, seen, color, uniform, residual[[0, -1]], free)
    return PartEstimates(*(x if x.dtype == np.int64 else x.astype(np.float32) for x in estimates), light=light)


def _light_errors(
    inner: InnerPixels, roughness: np.ndarray, metallic: np.ndarray, center: np.ndarray, side: float
) -> LightErrors:
    """What the base colours within parts (S,) of these roughnesses and metallics say of the traced light."""
    key, cell = cells_of(inner.place, inner.segment, center, side)
    offset, slope = line_in_base_color(inner.shading, roughness[inner.segment], metallic[inner.segment])
    base = best_base_color(inner.radiance, offset, slope, cell, len(key))
    owner = np.zeros(len(key), np.int64)
    owner[cell] = inner.segment
    return measured(key, base, (np.bincount(cell, minlength=len(key)) >= FEWEST) & (metallic[owner] == 0), center, side)


def search_threads() -> int:
    """How many roughnesses are tried side by side; each takes `BYTES_A_SEARCHED` for a pixel."""
    return min(torch.get_num_threads(), _MOST_THREADS)


class _Pieces:
    """What is left of the pixels for a pair (s, m), by segment: within its pieces and between them.

    A piece with a colour of its own explains away much of what a wrong pair does: the fewer pixels it has, the more.
    So the residual of pieces from one colour of the whole part counts too. Were residuals normal, the likelihood of n
    pixels in P pieces would have n - P deviations within and P between: both residuals enter with these exponents.

    Parameters
    ----------
    piece
        (N,) piece of each pixel.
    trust
        (N,) weight of each pixel.
    count
        Number of segments S.

    Attributes
    ----------
    free
        (S,) deviations that are left of a segment's pixels, without one colour a piece and the pair.
    """

    def __init__(self, inner: InnerPixels, piece: np.ndarray, trust: np.ndarray, count: int) -> None:
        self._inner, self._piece, self._trust, self._count = inner, piece, trust, count
        self._pieces = int(piece.max(initial=-1)) + 1
        self._weight = np.bincount(piece, trust, self._pieces)
        self._segment = np.zeros(self._pieces, np.int64)
        self._segment[piece] = inner.segment
        self._radiance = self._means(inner.radiance)
        self._encoded, self._encoded_means = srgb_encode(inner.radiance), srgb_encode(self._radiance)
        self._pixel_weight = encoded_weight(inner.radiance)  # the same for every pair: powers are dear
        self._piece_weight = self._weight[:, None] * encoded_weight(self._radiance)
        pixels, pieces = (
            np.bincount(inner.segment, trust > 0, count),
            np.bincount(self._segment, self._weight > 0, count),
        )
        self._between = pieces / np.maximum(pixels, 1)
        self.free = pixels - pieces - _PAIR

    def residuals(self, s: float) -> list[np.ndarray]:
        """(S,) of roughness ``s`` and every metallic, in their order."""
        lobes = specular_shading(self._inner.shading, s)
        return [self._residual(*line_of_lobes(self._inner.shading[:, 0], *lobes, m)) for m in _METALLIC]

    def _residual(self, offset: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """(S,) mean absolute differences of sRGB-encoded radiance within pieces and between them, together.

        ``offset`` and ``slope`` (N, 3) are the pixels' radiance as a line in the base colour.
        """
        inner = self._inner
        own = best_base_color(inner.radiance, offset, slope, self._piece, self._pieces, self._pixel_weight)
        own = np.clip(own, 0, 1)[self._piece]
        within = self._mean(_difference(offset + slope * own, self._encoded), inner.segment, self._trust)
        offset, slope = self._means(offset), self._means(slope)
        part = best_base_color(self._radiance, offset, slope, self._segment, self._count, self._piece_weight)
        modelled = offset + slope * np.clip(part, 0, 1)[self._segment]
        between = self._mean(_difference(modelled, self._encoded_means), self._segment, self._weight)
        return np.maximum(within, _NO_ERROR) ** (1 - self._between) * np.maximum(between, _NO_ERROR) ** self._between

    def _means(self, values: np.ndarray) -> np.ndarray:
        """(pieces, 3) means of values (N, 3)."""
        total = [np.bincount(self._piece, self._trust * values[:, c], self._pieces) for c in range(3)]
        return np.stack(total, axis=1) / np.maximum(self._weight, 1e-12)[:, None]

    def _mean(self, error: np.ndarray, segment: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(S,) weighted means of errors by segment."""
        return np.bincount(segment, error * weight, self._count) / np.maximum(
            np.bincount(segment, weight, self._count), 1e-9
        )


def _difference(modelled: np.ndarray, encoded: np.ndarray) -> np.ndarray:
    """(N,) mean absolute difference of modelled radiance (N, 3) from what was seen, which is sRGB-encoded (N, 3)."""
    return np.minimum(np.abs(srgb_encode(np.maximum(modelled, 0)) - encoded).mean(axis=1), _OUTLIER)


def _chosen(residual: np.ndarray, free: np.ndarray, metals: JudgedMetals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roughness, metallic and gain (S,) from residuals (metallic, roughness, S); cautious where little is gained.

    Of what is known to be metal, a dielectric must explain clearly more. Where a dielectric explains all that can be
    seen, no metal does so better.
    """
    rough = np.array(ROUGHNESS)
    caution = _CAUTION / np.sqrt(np.maximum(free, 1))
    cautious = residual * (1 + caution * (1 - rough)[None, :, None])
    per_metal, pure_metal = cautious.min(axis=1), len(_METALLIC) - 1
    metal = per_metal.argmin(axis=0)
    segments = np.arange(residual.shape[2])
    # a surface is metal or not: what is neither must explain as much more than metal as metal must than dielectric
    pure = per_metal[-1] * (1 - _METAL_GAIN) <= per_metal[metal, segments]
    metal = np.where((metal > 0) & pure, pure_metal, metal)
    margin = 1 - _METAL_GAIN - caution
    least, dielectric = per_metal.min(axis=0) + UNSEEN_DIFFERENCE, per_metal[0] + UNSEEN_DIFFERENCE
    believed = (least < margin * dielectric) & ~np.isin(segments, list(metals.dielectric))
    metal = np.where(believed, metal, 0)
    said = np.array([metals.roughness.get(segment, np.nan) for segment in segments])
    claimed = ~np.isnan(said) & (per_metal[-1] * margin <= per_metal[0])
    metal = np.where(claimed, pure_metal, metal)
    choice = cautious[metal, :, segments].argmin(axis=1)
    matte = residual[0, -1]
    best = residual[metal, choice, segments]
    known = free >= FEWEST
    return (
        np.where(known, rough[choice], np.where(claimed, said, 1.0)),
        np.where(known | claimed, np.array(_METALLIC)[metal], 0.0),
        np.where(known, 1 - best / np.maximum(matte, 1e-9), 0.0),
    )


def _expected(
    roughness: np.ndarray, metallic: np.ndarray, residual: np.ndarray, free: np.ndarray, classes: np.ndarray | None
) -> np.ndarray:
    """Roughness (S,), where dielectric parts prove no smoothness: the median of what it may be in this room."""
    below = posterior(np.array(ROUGHNESS), residual, free, classes).probability[0].cumsum(axis=0)
    median = np.array(ROUGHNESS)[(below >= below[-1] / 2).argmax(axis=0)]
    result = np.where((roughness >= 1) & (metallic == 0), median, roughness)
    result[0] = roughness[0]  # no part, nothing to expect
    return result


def _of_classes(
    own: tuple[np.ndarray, np.ndarray, np.ndarray], used: np.ndarray, classes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates (S,) where parts that claim nothing have those of their semantic class.

    A class counts where it is one material: several of its parts, with most of its pixels, claim nearly the same.
    """
    roughness, metallic, gain = (values.copy() for values in own)
    claims = (own[0] < 1) | (own[1] > 0)
    for k in np.unique(classes[classes > 0]):
        known, unknown = (classes == k) & claims & (used > 0), (classes == k) & ~claims
        agree = np.count_nonzero(known) >= _FEWEST_WITNESSES and np.ptp(own[1][known]) == 0
        agree = agree and own[0][known].std() <= _AGREE
        if agree and used[known].sum() >= used[unknown].sum():
            for values, mine in zip((roughness, metallic, gain), own, strict=True):
                values[unknown] = np.average(mine[known], weights=used[known])
    return roughness, metallic, gain
