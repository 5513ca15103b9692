"""Whether a region reflects or emits: how well either explains its radiance in all views, given the traced shading.

A region is cut into pieces (a voxel, one facing). Of a piece, each view has a mean radiance C and mean shading; the
shading outputs enter linearly, so that the mean of what is modelled is the model of the mean. With the terms A and B
of `line_in_base_color` at roughness s, the hypotheses are

    reflects, no metal    C = A(view) + min(L, g Ld)      L the piece's median of C - A: any base colour up to white
    reflects, metal       C = g (A(view) + B(view) a)     a in [0, 1] for each piece: its picture moves with the viewer
    emits                 C = L                           the same from everywhere
    emits and reflects    C = A(view) + L                 a screen under a gloss; one parameter more

g >= 1 says that the shading of the whole region is too dark. Surface that could be matte and grey cannot be told from
an emitter, and counts as grey: what speaks for emission is more light than white would send back, unless a mirror
explains it view by view; or an evenness under uneven light that paint has by chance alone (`texture`).

A view is one observation of a region: its pixels share what is wrong with the shading. Its residual e, the mean
absolute difference of log radiance, costs as a Student-t variable, whose scale is the residual of this room's ordinary
surface; g costs (ln g)^2 / 2 sigma^2, with sigma how much shading and radiance disagree between pieces of ordinary
regions. Both are measured anew in every round. Emission is believed if it explains the region better by more than its
price: the logarithm of how many regions of this size there are, or of how many touch what emits. What emission leaves
unexplained itself, beyond what ordinary surface does, counts against it once more: then both may be wrong.

A small emitter fills a few pixels, and so few views are worth less than any price. Where emission is ahead by half of
its price, and half of the region's pixels are brighter by `EMITTER_GAIN` than any material could be, mirrors included,
it is believed too; not beside another emitter, whose light its few pixels may share. Half of the price is also enough
where the radiance is that of an emitter of which there is no doubt, and few other regions have it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fipt.conventions import EMITTER_GAIN
from fipt.groups import grouped_median
from fipt.model.reflectance import brightest_reflection, line_in_base_color
from fipt.robust import deviation as robust_deviation
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import scene_box
from fipt.scene.shading import diffuse_shading
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.emitters.fragments import LEAST_DIFFERENCE
from fipt.stages.emitters.observations import Observations
from fipt.stages.emitters.regions import Surface
from fipt.stages.emitters.texture import TextureOdds, deviation

_RESOLUTION = (48, 96)
"""Pieces along the scene box, at least and at most: a mirror's picture and the room's light differ between them."""
_PIECE = 4.0
"""Width of a piece, pixels, between these: enough pixels for a median."""
_GLOSS = (0.02, 0.118, 0.3, 0.5)
"""Roughness of a gloss over a diffuse or emitting surface; rougher ones hardly depend on the view."""
_METAL = (0.02, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
_GAIN = np.exp([0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6, 0.8, 1.1, 1.5, 2, 3])
"""How much too dark the shading may be."""
_FEWEST_PIXELS = 4
"""Pixels of a piece that tell its share of a region's texture: with fewer one mixed one shifts it."""
_LEAST_BASE = 1e-3
"""Base colour of metal below which only noise differs."""
_FREEDOM = 3.0
"""Degrees of freedom of residuals: the fewest with a finite variance; edges and leaks make the tail heavy."""
_WHOLE = 8
"""Pixels of a region that a view needs to count fully; a few may all be on its edge."""
_ORDINARY = 2000
"""Regions at most whose residual is measured."""
_LEAST_SPREAD = 0.02
"""Least scale of residuals: shading and camera noise are never below."""
_LEAST_ERROR = 0.05
"""Least sigma of the shading."""
_UNMEASURED = 0.1
"""Both, where too little ordinary surface is seen to measure them: shading is off by about this in whole rooms."""
_MEASURED = 6
"""Observations below which a median deviation is itself off by half and more."""
_LEAST_PRICE = float(np.log(2))
"""Price of emission beside an emitter, for each region that could: even odds."""
_LIT_GAIN = 4.0
"""A lamp nearby that no view shows may make surface brighter than any reflection of the known light by this: a strip
below a cupboard gives the tiles behind it two to four times the light of the room."""
_EXCESS = 0.1
"""Share of a region's pixels that must be brighter than white before it is looked at."""


@dataclass(frozen=True)
class RegionEvidence:
    """What speaks for each of R regions, natural logarithms.

    Attributes
    ----------
    reflects, emits
        (R,) cost of the best material, and of emission with or without a gloss; 0 where not looked at.
    texture
        (R,) what the cost of the best material grows by, if it pays for the texture that it needs.
    compared
        Regions among which `texture` says how rare it is.
    price
        (R,) what emission must explain better.
    excess
        (R,) bool: half of its pixels are brighter by `EMITTER_GAIN` than any reflection.
    certain
        (R,) bool: half of its pixels are brighter by `_LIT_GAIN`: no lamp nearby lights surface so much.
    ordinary
        (R,) cost of residuals of one scale.
    pixels
        (R,) int64 pixels of the region.
    level
        (R, 3) median radiance; 0 without pixels.
    """

    reflects: np.ndarray
    emits: np.ndarray
    texture: np.ndarray
    compared: int
    price: np.ndarray
    excess: np.ndarray
    certain: np.ndarray
    ordinary: np.ndarray
    pixels: np.ndarray
    level: np.ndarray

    @property
    def lead(self) -> np.ndarray:
        """(R,) evidence for emission before its price."""
        return self.reflects - self.emits - np.maximum(self.emits - self.ordinary, 0)

    @property
    def ahead(self) -> np.ndarray:
        """(R,) bool: emission explains the region better, by at least half of its price."""
        return self.reflects - self.emits > 0.5 * self.price

    @property
    def needed(self) -> np.ndarray:
        """(R,) evidence of texture needed: the price, and more than one region of all compared has by chance."""
        return np.maximum(self.price, np.log(self.compared + 1))

    @property
    def _even(self) -> np.ndarray:
        """(R,) bool: paint would need too much texture, even if all counts that speaks against emission (`lead`)."""
        return self.texture + np.minimum(self.lead, 0) > self.needed

    @property
    def undecided(self) -> np.ndarray:
        """(R,) bool: emission explains the region better, but not by its price, or only with both kinds of evidence.

        Two kinds for it are no sum: wrong shading makes a region too bright and too even at once.
        """
        both = (self.texture > 0) & (self.lead + self.texture > self.needed)
        return (self.ahead | both) & (self.lead <= self.price) & ~self._even & ~self.excess

    def emitting(self, pairs: np.ndarray) -> np.ndarray:
        """(R,) bool: emission is worth its price. Where a region touches another that emits, few others do.

        Parameters
        ----------
        pairs
            (2, N) regions that touch.
        """
        result = (self.lead > self.price) | self._even
        result |= self._kin(result)
        for _ in range(len(result)):
            beside = self._beside(result, pairs)
            more = beside & (self.lead > np.log(max(int(beside.sum()), 1)) + _LEAST_PRICE)
            if not more.any():
                break
            result |= more
        return result | self.ahead & self.excess & ~self._beside(result, pairs)

    def _kin(self, chosen: np.ndarray) -> np.ndarray:
        """(R,) bool: half of the price is there, and the radiance is that of an emitter brighter than any material.

        So few others have it by chance that it is worth the other half: one of many panels, where the room is bright.
        """
        asked = ~chosen & (self.lead >= 0) & (np.maximum(self.lead, self.texture) > 0.5 * self.price)
        certain, others = self.level[chosen & self.excess], self.level[(self.pixels >= _WHOLE) & ~chosen]
        result = np.zeros(len(chosen), bool)
        for region in np.flatnonzero(asked & (self.pixels >= _WHOLE)):
            own = self.level[region]
            near, by_chance = (
                (np.abs(other - own) <= LEAST_DIFFERENCE * own.mean()).all(axis=1) for other in (certain, others)
            )
            result[region] = near.any() and -np.log(by_chance.mean()) > 0.5 * self.price[region]  # itself is among them
        return result

    @staticmethod
    def _beside(chosen: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """(R,) bool: regions that touch a chosen one (R,), and are none."""
        result = np.zeros(len(chosen), bool)
        for a, b in (pairs, pairs[::-1]):
            result[b[chosen[a]]] = True
        return result & ~chosen


def judge(shards: Sequence[ObservedShard], seen: Observations, surface: Surface) -> RegionEvidence:
    """Weigh reflection against emission for every region.

    ``seen`` are pixels of all training views, sorted by view.
    """
    pixels = np.bincount(surface.region[seen.triangle] + 1, minlength=surface.count + 1)[1:]
    price = np.log(max(len(seen.triangle), 1) / np.maximum(pixels, 1))
    chosen, excess, certain, ordinary = _candidates(shards, seen, surface)
    known, nothing = chosen | ordinary, np.zeros(surface.count)
    level, found, index = np.zeros((surface.count, 3)), *np.unique(surface.region[seen.triangle], return_inverse=True)
    level[found[found >= 0]] = grouped_median(seen.radiance, index.reshape(-1), len(found))[found >= 0]
    if not known.any():
        return RegionEvidence(nothing, nothing, nothing, 0, price, excess, certain, nothing, pixels, level)
    cells = _cells(shards, seen, np.append(np.where(known, np.arange(surface.count), -1), -1)[surface.region], surface)
    costs = _costs(cells, *_scales(cells, ordinary))
    reflects, emits = costs.reflects.min(axis=0), np.where(known, costs.emits, 0)
    # no darker than white anywhere: by its radiance it is no emitter, whatever fits
    reflects = np.where(chosen, reflects, np.minimum(reflects, emits) * known)
    price = price + 0.5 * np.log(np.maximum(costs.views, 1))  # of L, as BIC has it
    of_ordinary = costs.views * float(_cost(np.array(1.0)))
    found = RegionEvidence(reflects, emits, nothing, 0, price, excess, certain, of_ordinary, pixels, level)
    odds = TextureOdds.of(costs.texture[0, (costs.texture[0] != 0) & (found.lead <= price)])
    paid = (costs.reflects + odds(costs.texture)).min(axis=0) - costs.reflects.min(axis=0)
    return replace(found, texture=np.where(known, paid, 0), compared=odds.regions)


@dataclass(frozen=True)
class _Cells:
    """N cells, each a piece of a region in one view.

    Attributes
    ----------
    radiance, shading, pixels
        (N, 3) and (N, outputs, 3) means; (N,) number of pixels.
    piece, pair
        (N,) number of the piece, and of the pair of region and view.
    region_of_piece, region_of_pair
        (P,) and (Q,).
    regions
        Number of all regions.
    dark
        Radiance below which differences do not count.
    """

    radiance: np.ndarray
    shading: np.ndarray
    pixels: np.ndarray
    piece: np.ndarray
    pair: np.ndarray
    region_of_piece: np.ndarray
    region_of_pair: np.ndarray
    regions: int
    dark: float

    @cached_property
    def white(self) -> np.ndarray:
        """(P, 3) Ld of each piece, over all views: its noise is not the surface's."""
        count = np.bincount(self.piece, self.pixels)
        return np.stack([np.bincount(self.piece, self.pixels * ld) / count for ld in self.shading[:, 0].T], axis=1)

    @cached_property
    def pixels_of_pair(self) -> np.ndarray:
        """(Q,) pixels of each region in each view."""
        return np.bincount(self.pair, self.pixels)

    @cached_property
    def weight_of_pair(self) -> np.ndarray:
        """(Q,) how much of an observation a view is."""
        return np.minimum(self.pixels_of_pair / _WHOLE, 1)

    def median(self, values: np.ndarray) -> np.ndarray:
        """(P, 3) median over the views of each piece."""
        return grouped_median(values, self.piece, len(self.region_of_piece))

    def residual(self, modelled: np.ndarray) -> np.ndarray:
        """(Q,) mean absolute difference of log radiance of each region in each view."""
        difference = np.abs(np.log((np.maximum(modelled, 0) + self.dark) / (self.radiance + self.dark))).mean(axis=1)
        return np.bincount(self.pair, self.pixels * difference) / self.pixels_of_pair


def _candidates(
    shards: Sequence[ObservedShard], seen: Observations, surface: Surface
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(R,) bool each: brighter than white in places; `excess` and `certain` of `RegionEvidence`; and ordinary ones."""
    bright, over_reflection, over_lit, total = (np.zeros(surface.count) for _ in range(4))
    for shard, own in _by_view(shards, seen):
        region = surface.region[seen.triangle[own]]
        known = region >= 0
        region, sample, radiance = region[known], seen.sample[own][known], seen.radiance[own][known].mean(axis=1)
        over = radiance > diffuse_shading(shard.shading, sample).mean(axis=1)
        most = brightest_reflection(np.asarray(shard.shading[sample[over]], np.float32))
        bright += np.bincount(region, over, surface.count)
        over_reflection += np.bincount(region[over], radiance[over] > EMITTER_GAIN * most, surface.count)
        over_lit += np.bincount(region[over], radiance[over] > _LIT_GAIN * most, surface.count)
        total += np.bincount(region, minlength=surface.count)
    chosen = bright > _EXCESS * np.maximum(total, 1)
    others = np.flatnonzero(~chosen & (total >= _WHOLE))
    ordinary = np.zeros(surface.count, bool)
    ordinary[others[:: max(len(others) // _ORDINARY, 1)]] = True
    return chosen, 2 * over_reflection > total, 2 * over_lit > total, ordinary


def _by_view(shards: Sequence[ObservedShard], seen: Observations) -> "list[tuple[ObservedShard, slice]]":
    """Every view's shard and its rows of ``seen``."""
    owners = [shard for shard in shards for _ in shard.samples.views]
    ends = np.searchsorted(seen.view, np.arange(len(owners) + 1))
    return [(shard, slice(int(ends[k]), int(ends[k + 1]))) for k, shard in enumerate(owners)]


def _cells(shards: Sequence[ObservedShard], seen: Observations, region: np.ndarray, surface: Surface) -> _Cells:
    """Cells of the triangles whose ``region`` (T,) is not negative; one view's shading is in memory at a time."""
    center, side = scene_box([shard.samples for shard in shards])
    widths = surface.width[surface.width > 0]
    resolution = (
        int(np.clip(side / (_PIECE * float(np.median(widths))), *_RESOLUTION)) if len(widths) else _RESOLUTION[0]
    )
    columns: list[tuple[np.ndarray, ...]] = []
    for view, (shard, own) in enumerate(_by_view(shards, seen)):
        of = region[seen.triangle[own]]
        rows, of = seen.sample[own][of >= 0], of[of >= 0]
        place, normal = np.asarray(shard.samples.position[rows]), np.asarray(shard.samples.normal[rows])
        record = voxel_keys(place, center, side, resolution).astype(np.int64) * FACINGS + facings(normal)
        key, cell, count = np.unique(record * surface.count + of, return_inverse=True, return_counts=True)
        radiance = seen.radiance[own][region[seen.triangle[own]] >= 0]
        values = np.concatenate([radiance[:, None], shard.shading[rows]], axis=1)
        outputs = values.shape[1]
        values = values.reshape(len(rows), 3 * outputs)  # no -1: a view may show none of the regions
        mean = np.stack([np.bincount(cell.reshape(-1), column, len(key)) for column in values.T], axis=1)
        mean = (mean / np.maximum(count, 1)[:, None]).astype(np.float32).reshape(len(key), outputs, 3)
        columns.append((mean[:, 0], mean[:, 1:], count, key, np.full(len(key), view)))
    radiance, shading, count, key, view_of = (np.concatenate(column) for column in zip(*columns, strict=True))
    pieces, piece = np.unique(key, return_inverse=True)
    of_piece = pieces % surface.count
    views = len(columns)
    pairs, pair = np.unique(of_piece[piece.reshape(-1)] * views + view_of, return_inverse=True)
    numbers = (piece.reshape(-1), pair.reshape(-1), of_piece, pairs // views)
    return _Cells(radiance, shading, count, *numbers, surface.count, max(surface.dark, 1e-9))


def _cost(residual: np.ndarray) -> np.ndarray:
    """Negative log likelihood of residuals in units of their scale, 0 at 0."""
    return 0.5 * (_FREEDOM + 1) * np.log1p(residual**2 / _FREEDOM)


def _scales(cells: _Cells, ordinary: np.ndarray) -> tuple[float, float]:
    """Scale of residuals of a region in a view, and relative error of shading, from ordinary surface."""
    least = np.full(len(cells.region_of_pair), np.inf)
    for gloss, own in (_coated(cells, roughness) for roughness in (None, *_GLOSS)):
        least = np.minimum(least, cells.residual(gloss + np.minimum(own, cells.white)[cells.piece]))
    use = ordinary[cells.region_of_pair] & (cells.pixels_of_pair >= _WHOLE)
    scale = _spread(least[use], _LEAST_SPREAD)
    albedo = np.log(cells.median(cells.radiance).mean(axis=1) + cells.dark)
    albedo -= np.log(cells.white.mean(axis=1) + cells.dark)
    sound = ordinary[cells.region_of_piece] & (np.bincount(cells.piece, cells.pixels) >= _WHOLE)
    sound &= np.bincount(cells.region_of_piece, sound, cells.regions)[cells.region_of_piece] >= 4
    owners, index = np.unique(cells.region_of_piece[sound], return_inverse=True)
    middle = grouped_median(albedo[sound], index.reshape(-1), len(owners))
    deviation = np.abs(albedo[sound] - middle[index.reshape(-1)])
    return scale, _spread(deviation, _LEAST_ERROR)


def _spread(deviation: np.ndarray, least: float) -> float:
    """Standard deviation of which these are absolute deviations, at least ``least``; `_UNMEASURED` of too few."""
    if len(deviation) < _MEASURED:
        return _UNMEASURED
    return max(float(robust_deviation(deviation)), least)


def _coated(cells: _Cells, roughness: float | None) -> tuple[np.ndarray | float, np.ndarray]:
    """What a gloss, or none, reflects (N, 3), and what the surface below sends out (P, 3)."""
    gloss = 0.0 if roughness is None else line_in_base_color(cells.shading, roughness, 0.0)[0]
    return gloss, cells.median(np.maximum(cells.radiance - gloss, 0))


def _metal(cells: _Cells, roughness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B (N, 3) and the best base colour (P, 3) of a metal, not clipped."""
    offset, slope = line_in_base_color(cells.shading, roughness, 1.0)
    weight = cells.pixels[:, None] * (cells.radiance + 0.05) ** -1.2  # about the squared slope of the sRGB curve
    over = [np.bincount(cells.piece, column) for column in (weight * slope * (cells.radiance - offset)).T]
    under = [np.bincount(cells.piece, column) for column in (weight * slope**2).T]
    return offset, slope, np.stack(over, axis=1) / np.maximum(np.stack(under, axis=1), 1e-12)


@dataclass(frozen=True)
class _Costs:
    """Costs of R regions.

    Attributes
    ----------
    reflects, texture
        (M, R) least cost of each of M materials, matte first, and how much more texture it needs than emission: the
        logarithm of the ratio, 0 where too few pieces tell.
    emits, views
        (R,) least cost of emission, and number of views.
    """

    reflects: np.ndarray
    texture: np.ndarray
    emits: np.ndarray
    views: np.ndarray


def _costs(cells: _Cells, scale: float, error: float) -> _Costs:
    """Cost of every material, and of emission."""

    def cost(modelled: np.ndarray) -> np.ndarray:
        each = cells.weight_of_pair * _cost(cells.residual(modelled) / scale)
        return np.bincount(cells.region_of_pair, each, cells.regions)

    def uneven(values: np.ndarray) -> np.ndarray:
        pixels = np.bincount(cells.piece, cells.pixels)
        return deviation(np.log(values), pixels * (pixels >= _FEWEST_PIXELS), cells.region_of_piece, cells.regions)

    even = uneven(cells.median(cells.radiance).mean(axis=1) + cells.dark)

    def texture(values: np.ndarray) -> np.ndarray:
        found = uneven(values)
        return np.where((found > 0) & (even > 0), np.log(np.maximum(found, 1e-9) / np.maximum(even, 1e-9)), 0)

    emits, reflects, textures = np.full(cells.regions, np.inf), [], []
    penalty = 0.5 * (np.log(_GAIN) / error) ** 2
    for roughness in (None, *_GLOSS):
        gloss, own = _coated(cells, roughness)
        emits = np.minimum(emits, cost(gloss + own[cells.piece]) + (roughness is not None))
        grey = (cost(gloss + np.minimum(own, gain * cells.white)[cells.piece]) for gain in _GAIN)
        reflects.append(np.min([each + more for each, more in zip(grey, penalty, strict=True)], axis=0))
        textures.append(texture((own.mean(axis=1) + cells.dark) / (cells.white.mean(axis=1) + cells.dark)))
    for roughness in _METAL:
        offset, slope, base = _metal(cells, roughness)
        metal = (cost(gain * (offset + slope * np.clip(base / gain, 0, 1)[cells.piece])) for gain in _GAIN)
        reflects.append(np.min([each + more for each, more in zip(metal, penalty, strict=True)], axis=0))
        textures.append(texture(np.maximum(base.mean(axis=1), _LEAST_BASE)))
    views = np.bincount(cells.region_of_pair, cells.weight_of_pair, cells.regions)
    return _Costs(np.array(reflects), np.array(textures), emits, views)
