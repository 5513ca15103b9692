"""What pixels at a region say of its material: how well each roughness and metallic explains them, and which colour.

With a *trial*, a roughness and a metallic, radiance is a line in the base colour. All pixels at one small piece of a
region share the base colour that explains them best; what is left over measures the trial. The sum of what is left
over pieces, and the sum of its products between trials, tell how much better one trial is than another and how sure
that is. Both add up when regions are joined.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from fipt.conventions import DARK_BASE_COLOR, UNSEEN_DIFFERENCE
from fipt.formats.images import srgb_encode
from fipt.model.reflectance import line_in_base_color
from fipt.robust import deviation, spread
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.segment.region_pixels import RegionPixels

ROUGHNESS = (0.02, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
TRIALS = tuple(product((0.0, 1.0), ROUGHNESS))
"""(metallic, roughness); the first half is not metal."""
HALF = len(ROUGHNESS)
MATTE = HALF - 1
"""Trial of what is no metal and fully rough."""
_RESOLUTION = 96
"""Pieces along the scene box, as in the part search of the fit."""
_FEWEST = 4
"""Pixels, whole or in shares, that a piece must have to judge a trial: with fewer the base colour explains anything."""
_OUTLIER = 0.2
"""What is left counts up to here (sRGB-encoded): edges and shadows that the shading misses."""
_SOME_PIECES = 5
"""Pieces that a region must have in either half to tell the spread of base colour within it."""
_SOME_REGIONS = 5
"""Regions whose halves tell an error."""
_THIN = 0.9
"""Mean share of its pixels below which a region is thin."""
_UNKNOWN = 0.1
"""Standard deviation of the colour where no region is large enough to tell."""
CHI_SQUARE = 7.815
"""95 % quantile of chi square with three degrees of freedom: by how much colours differ that are one, in variances."""
STANDARD_ERRORS = 1.96
"""Standard errors by which one trial must be worse than another: 95 % of chance, as for colours."""
_METAL_GAIN = 0.1
_CAUTION = 0.5
"""Of what is left metal must remove this share, and _CAUTION / sqrt(pixels) more, to be proved; so must dielectrics."""


@dataclass(frozen=True)
class MaterialEvidence:
    """Evidence of R regions under T trials.

    Attributes
    ----------
    left
        (R, T) sum over the pieces of what a trial leaves unexplained.
    products
        (R, T, T) sum over the pieces of the products of what two trials leave.
    color
        (R, T, 3) mean base colour, made for comparing: `comparable`.
    pixels, judged
        (R,) float64 number of pixels, and of those in pieces that judge a trial; a shared one counts by its share.
    usual
        (R,) float64 ``judged`` times what pieces of the room leave in the median under the best trial of their region.
    metal
        (R,) bool: the pixels are explained by metal only.
    variance
        (R, 3) of the region's comparable colour: its error, and that of few pieces.
    """

    left: np.ndarray
    products: np.ndarray
    color: np.ndarray
    pixels: np.ndarray
    judged: np.ndarray
    usual: np.ndarray
    metal: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True)
class ColorPieces:
    """G pieces of regions, each with a base colour of its own under every trial.

    Attributes
    ----------
    owner
        (G,) int64 region, from 0.
    voxel
        (G, 3) int64 voxel of the scene box.
    place
        (G, 3) mean place of its pixels, metres.
    key
        (G,) int64 of voxel, facing and region, ascending.
    number
        (G,) float64 number of its pixels; a shared one counts by its share.
    share
        (G,) mean share that the region has of them.
    judged
        (G,) bool: enough of them to judge a trial.
    left
        (G, T) mean difference that a trial leaves, sRGB-encoded.
    color
        (G, T, 3) base colour that goes with it: `comparable`.
    """

    owner: np.ndarray
    voxel: np.ndarray
    place: np.ndarray
    key: np.ndarray
    number: np.ndarray
    share: np.ndarray
    judged: np.ndarray
    left: np.ndarray
    color: np.ndarray


def comparable(color: np.ndarray) -> np.ndarray:
    """(..., 3) mean logarithm of base colours (..., 3), and logarithms of red and of blue over green."""
    logs = np.log(np.clip(color, 0, 1.5) + DARK_BASE_COLOR)
    return np.stack([logs.mean(-1), logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]], axis=-1)


def _base_color(color: np.ndarray) -> np.ndarray:
    """(..., 3) base colour in [0, 1] of a `comparable` one (..., 3)."""
    green = color[..., 0] - (color[..., 1] + color[..., 2]) / 3
    logs = np.stack([green + color[..., 1], green, green + color[..., 2]], axis=-1)
    return np.clip(np.exp(logs) - DARK_BASE_COLOR, 0, 1)


def color_pieces(pixels: RegionPixels, region: np.ndarray, count: int, center: np.ndarray, side: float) -> ColorPieces:
    """Gather pixels into pieces: a voxel, a region, one facing.

    Parameters
    ----------
    region
        (N,) region of each pixel, from 0.
    count
        R, regions.
    center, side
        The scene box, metres.
    """
    keys = _piece_keys(pixels.place, pixels.normal, region, count, center, side)
    key, piece = np.unique(keys, return_inverse=True)
    piece, voxel = piece.reshape(-1), key // count // FACINGS
    number = np.bincount(piece, pixels.share, len(key))
    of_axes = [np.bincount(piece, pixels.share * axis, len(key)) for axis in pixels.place.T]
    place = np.stack(of_axes, axis=1) / number[:, None]
    left, color = tried(pixels, piece, len(key))
    place_of_voxel = np.stack(
        [voxel % _RESOLUTION, voxel // _RESOLUTION % _RESOLUTION, voxel // _RESOLUTION**2], axis=1
    )
    share = number / np.bincount(piece, minlength=len(key))
    return ColorPieces(key % count, place_of_voxel, place, key, number, share, number >= _FEWEST, left, color)


def _piece_keys(
    place: np.ndarray, normal: np.ndarray, region: np.ndarray, count: int, center: np.ndarray, side: float
) -> np.ndarray:
    """(N,) int64 of the voxel, the facing and the region (N,) of points (N, 3)."""
    return (voxel_keys(place, center, side, _RESOLUTION) * FACINGS + facings(normal)) * count + region


def measure(found: ColorPieces, count: int) -> MaterialEvidence:
    """Measure the evidence of ``count`` regions."""
    owner, number, judged, color, place = found.owner, found.number, found.judged, found.color, found.place
    left = np.where(judged[:, None], found.left * number[:, None], 0.0)
    total = np.stack([np.bincount(owner, column, count) for column in left.T], axis=1)
    order = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[order], np.arange(count + 1))
    products = np.zeros((count, len(TRIALS), len(TRIALS)))
    means = np.zeros((count, len(TRIALS), 3))
    pieces, noise = np.ones(count), _ColorNoise()
    of_region = np.bincount(owner, number, count)
    thin = of_region < _THIN * np.bincount(owner, number / found.share, count)
    best = best_trials(total, total.sum(axis=0), slice(None))
    for k in range(count):
        own = order[bounds[k] : bounds[k + 1]]
        products[k] = left[own].T @ left[own]
        own = own[judged[own]] if judged[own].any() else own
        means[k] = np.average(color[own], axis=0, weights=number[own])
        pieces[k] = len(own)
        noise.add(color[own, best[k]], place[own], bool(thin[k]))
    judging = np.bincount(owner, number * judged, count)
    usual = judging * np.median(found.left[judged, best[owner[judged]]]) if judged.any() else judging
    metal = is_metal(total, judging, usual)
    return MaterialEvidence(total, products, means, of_region, judging, usual, metal, noise.variance(pieces, thin))


@dataclass(frozen=True)
class BestMaterials:
    """The materials that explain regions best: the base colour of each piece, elsewhere that of its region.

    Attributes
    ----------
    known
        (R,) region ids, ascending.
    trial
        (R,) int64 index into `TRIALS`.
    base_color, of_pieces
        (R, 3) of regions, (G, 3) of pieces, in [0, 1].
    key
        (G,) of the pieces, as in `ColorPieces`.
    center, side
        The scene box, metres.
    """

    known: np.ndarray
    trial: np.ndarray
    base_color: np.ndarray
    of_pieces: np.ndarray
    key: np.ndarray
    center: np.ndarray
    side: float

    @classmethod
    def of(
        cls, known: np.ndarray, pieces: ColorPieces, evidence: MaterialEvidence, center: np.ndarray, side: float
    ) -> "BestMaterials":
        """Those of the regions with ids ``known`` (R,); metal where its evidence says so."""
        room = evidence.left.sum(axis=0)
        dielectric = best_trials(evidence.left, room, slice(None, HALF))
        trial = np.where(evidence.metal, best_trials(evidence.left, room, slice(HALF, None)), dielectric)
        colors = evidence.color[np.arange(len(known)), trial]
        of_pieces = pieces.color[np.arange(len(pieces.owner)), trial[pieces.owner]]
        return cls(known, trial, _base_color(colors), _base_color(of_pieces), pieces.key, center, side)

    def radiance(self, region: np.ndarray, place: np.ndarray, normal: np.ndarray, shading: np.ndarray) -> np.ndarray:
        """(K, 3) reflected by samples: regions (K,), places and normals (K, 3), shading (K, outputs, 3).

        NaN where the region is not known.
        """
        own = np.minimum(np.searchsorted(self.known, region), len(self.known) - 1)
        key = _piece_keys(place, normal, own, len(self.known), self.center, self.side)
        piece = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        color = np.where((self.key[piece] == key)[:, None], self.of_pieces[piece], self.base_color[own])
        result = np.full((len(region), 3), np.nan)
        for k, (metallic, roughness) in enumerate(TRIALS):
            at = np.flatnonzero((self.trial[own] == k) & (self.known[own] == region))
            offset, slope = line_in_base_color(shading[at], roughness, metallic)
            result[at] = offset + slope * color[at]
        return result


class _ColorNoise:
    """How far off the colour of a region is, learned from regions that are large enough to be cut in halves.

    Halves of one region are of one material, but for texture: what their means differ by is the error of the shading,
    as it is from one region to the next. It does not become less with more pieces. What pieces differ by does. Thin
    regions are told by what others leave of pixels, and err by more: they are learned from apart.
    """

    def __init__(self) -> None:
        self._spread: tuple[list[np.ndarray], list[np.ndarray]] = [], []
        self._halves: tuple[list[np.ndarray], list[np.ndarray]] = [], []

    def add(self, color: np.ndarray, place: np.ndarray, thin: bool) -> None:
        """Learn from pieces of one region, which may be thin: comparable colours (N, 3) and places (N, 3)."""
        if len(color) < 2 * _SOME_PIECES:
            return
        self._spread[thin].append(spread(color))
        away = place - place.mean(axis=0)
        along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
        high = along > np.median(along)
        if 0 < np.count_nonzero(high) < len(high):
            self._halves[thin].append(np.median(color[high], axis=0) - np.median(color[~high], axis=0))

    def variance(self, pieces: np.ndarray, thin: np.ndarray) -> np.ndarray:
        """(R, 3) variance of the colour of regions of so many pieces (R,), of which some are ``thin`` (R,)."""
        if not any(self._halves):
            return np.full((len(pieces), 3), _UNKNOWN**2)
        of_kind = [self._of_kind(kind, pieces) for kind in (0, 1)]
        return np.where(thin[:, None], np.maximum(*of_kind), of_kind[0])

    def _of_kind(self, kind: int, pieces: np.ndarray) -> np.ndarray:
        """(R, 3) variance as the regions of a kind tell it, 1: thin; as all do, where these are few."""
        halves, spreads = self._halves[kind], self._spread[kind]
        if len(halves) < _SOME_REGIONS:
            halves, spreads = ([*kinds[0], *kinds[1]] for kinds in (self._halves, self._spread))
        shared = deviation(np.array(halves), axis=0)
        usual = np.median(spreads, axis=0)
        return np.maximum(shared**2 / 2 + usual**2 / pieces[:, None], DARK_BASE_COLOR**2 / 4)


def misfit(left: np.ndarray, square: np.ndarray | float = 0.0) -> np.ndarray:
    """(...) cost of observations that miss a material, each one of Student's t (3 degrees of freedom).

    ``left`` (...) is what its trial leaves, in standard deviations; ``square`` (...) the squared difference of colours,
    in variances, summed over three channels.
    """
    return 2 * np.log1p(left**2 / 3) + 3 * np.log1p(square / 3)


def tried(pixels: RegionPixels, piece: np.ndarray, pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of what each trial leaves of each piece (G, T), and the `comparable` base colour (G, T, 3) of it."""
    seen = srgb_encode(pixels.radiance)
    share = pixels.share  # what is off in a pixel is off by 1 / share in the part of it
    weight = share[:, None] * (pixels.radiance + 0.05) ** -1.2  # about the squared slope of the sRGB curve
    left, color = np.empty((pieces, len(TRIALS))), np.empty((pieces, len(TRIALS), 3))
    for k, (metallic, roughness) in enumerate(TRIALS):
        offset, slope = line_in_base_color(pixels.shading, roughness, metallic)
        steep, above = weight * slope, pixels.radiance - offset
        over = [np.bincount(piece, steep[:, c] * above[:, c], pieces) for c in range(3)]
        under = [np.bincount(piece, steep[:, c] * slope[:, c], pieces) for c in range(3)]
        base = np.stack(over, axis=1) / np.maximum(np.stack(under, axis=1), 1e-9)
        color[:, k] = comparable(base)
        modelled = srgb_encode(offset + slope * np.clip(base, 0, 1)[piece])
        error = np.minimum(np.abs(modelled - seen).mean(axis=1), _OUTLIER)
        left[:, k] = np.bincount(piece, share * error, pieces)
    return left / np.bincount(piece, share, pieces)[:, None], color


def is_metal(left: np.ndarray, judged: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(R,) bool: metal leaves clearly less (R, T) of the pixels that judge it (R,) than any dielectric.

    ``usual`` (R,) as of `MaterialEvidence`: what they would leave in any case.
    """
    return _clearly_less(left[:, HALF:], left[:, :HALF], judged, usual)


def is_dielectric(left: np.ndarray, judged: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(R,) bool: a dielectric leaves clearly less (R, T) of the pixels that judge it (R,) than any metal.

    ``usual`` (R,) as of `MaterialEvidence`: what they would leave in any case.
    """
    return _clearly_less(left[:, :HALF], left[:, HALF:], judged, usual)


def _clearly_less(these: np.ndarray, others: np.ndarray, judged: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(R,) bool: the best of some trials (R, K) leaves clearly less than that of others.

    It is as cautious as the part search. What is ``usual`` (R,), and at least what shows nowhere, is added to what
    either leaves: where one explains as much as can be explained, nothing does so better.
    """
    caution = _METAL_GAIN + _CAUTION / np.sqrt(np.maximum(judged, 1))
    unseen = np.maximum(UNSEEN_DIFFERENCE * judged, usual)
    return these.min(axis=1) + unseen < (1 - caution) * (others.min(axis=1) + unseen)


def best_trials(left: np.ndarray, room: np.ndarray, trials: slice) -> np.ndarray:
    """(K,) int64 trial of ``trials`` that leaves the least (K, T); between equal ones, the least of the room (T,).

    What has no piece that judges is left the same by all of them, and the first is a mirror.
    """
    own = left[:, trials]
    equal = own == own.min(axis=1, keepdims=True)
    return np.where(equal, room[trials], np.inf).argmin(axis=1) + trials.indices(len(room))[0]


def worse(
    left: np.ndarray, products: np.ndarray, trial: np.ndarray, trials: slice, errors: float = STANDARD_ERRORS
) -> np.ndarray:
    """(K,) bool: a trial (K,) is worse than the best of ``trials`` by more than some standard errors.

    The evidence is (K, T) what trials leave, and (K, T, T) the products that tell its noise.
    """
    rows = np.arange(len(left))
    own = left[:, trials].argmin(axis=1) + trials.indices(2 * HALF)[0]
    more = left[rows, trial] - left[rows, own]
    square = products[rows, own, own] + products[rows, trial, trial] - 2 * products[rows, own, trial]
    return more > errors * np.sqrt(np.maximum(square, 0))
