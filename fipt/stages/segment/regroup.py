"""Parts from materials: regions of the surface that the pictures show to be of one material become one part.

Regions that were grown on the mesh end where they should, but there are far too many of them: a chair is ten. The two
that differ the least become one, again and again, as long as any two agree. Two agree where

- base colours differ by no more than noise: the squared difference of each channel over its variance, summed, stays
  below the 95 % quantile of chi square. The variance is that of pieces of one region, which holds texture and the error
  of the shading, which is much larger in brightness than in hue;
- both are metal, or neither, and one roughness and metallic explains both: it leaves more unexplained than the best of
  each alone by no more than chance does at the 95 % level, as the differences of pieces tell.

A region is metal where its own pixels clearly prove it. Legs and frames fill too few pixels for that: a metal explains
them only a little better than a dielectric. They count as metal where another region proves one of their colour; where
metal alone has that colour in the room, even if a dielectric explains them as well. Pixels that prove it must outnumber
undecided ones, or half of them where the colour is nearly the same. A region is no metal by its colour if it has, as a
dielectric, a colour that is more common among clear dielectrics. What tells neither goes with the clear metal around it
(`fipt.stages.segment.surrounded`). Copies of one shape judge together
(`fipt.stages.segment.copies`). Pixels beside emitters are left out. A region that has no others, as bars of a window,
is no metal, and where most are left out what is left must explain metal better; unless its copies elsewhere are metal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.formats.files import check_memory
from fipt.meshing.copies import first_copies
from fipt.scene.mesh import Mesh
from fipt.scene.metals import JudgedMetals
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import scene_box, segments_of_triangles
from fipt.stages.segment.copies import copied_regions, judged_with_copies, votes_of_copies
from fipt.stages.segment.fading import fading
from fipt.stages.segment.material_evidence import (
    CHI_SQUARE,
    HALF,
    ROUGHNESS,
    TRIALS,
    BestMaterials,
    ColorPieces,
    MaterialEvidence,
    best_trials,
    color_pieces,
    is_dielectric,
    measure,
    worse,
)
from fipt.stages.segment.region_pixels import RegionPixels, region_pixels, shared_pixels
from fipt.stages.segment.surrounded import with_surrounded

_LIKELY_ERRORS = 1.0
"""The same for a region whose colour metal alone has in the room: more than these, and it stays what it is."""
_NO_METAL_ERRORS = 0.5
"""The same for a part of which a dielectric is the better explanation: more than these, and the fit finds no metal."""
_CHANCE = 0.05
"""Share of what is metal that may look clearly worse as one: twice that chance, of which this is one side."""
_COMMON = 10.0
"""Odds that a metal whose proof is weak is a common paint, above which it is: strong evidence by Jeffreys' scale."""
_WINDOWS = ((CHI_SQUARE, 1.0), (2.366, 0.5))
"""Squared distances of colours, their 95 % and 50 % quantile, and how many pixels must prove a metal for each that
tells nothing: in the nearer half fewer other things have that colour."""


@dataclass(frozen=True)
class RegroupedParts:
    """Parts that regions were joined to.

    Attributes
    ----------
    parts
        Per shard: (P,) uint16 part of each pixel. What no pixel tells stays a part of its own.
    materials
        How many parts are of regions that pixels tell.
    metals
        Which parts are metal, and which are not.
    """

    parts: list[np.ndarray]
    materials: int
    metals: JudgedMetals


def regrouped(
    shards: Sequence[ObservedShard], regions: Sequence[np.ndarray], mesh: Mesh, alike: float = 1.0
) -> RegroupedParts:
    """Regions of pixels to parts of pixels.

    Parameters
    ----------
    regions
        Per shard: (P,) uint16 region of each pixel, 0 = unknown.
    mesh
        That the samples show: its copies of shapes, and its borders.
    alike
        How many pieces of a region err as one: their evidence has that much more variance.
    """
    present = np.setdiff1d(np.concatenate([np.unique(own) for own in regions]), [0])
    part_of = np.zeros(int(present.max(initial=0)) + 1, np.uint16)
    materials, metals, copied = 0, JudgedMetals(), {}
    known, pieces, evidence = _evidence(shards, regions)
    if len(known):
        counted = _mostly_counted(shards, regions, known)
        evidence = with_likely_metals(replace(evidence, products=evidence.products * alike), counted)
        _, of_triangle = segments_of_triangles([shard.samples for shard in shards], regions)
        evidence = with_surrounded(evidence, mesh, of_triangle, known, counted)
        copies = first_copies(mesh)
        evidence = judged_with_copies(evidence, copied_regions(copies, of_triangle, known))
        voters = _voters(evidence, counted)
        asked = np.setdiff1d(present, known[voters])
        copied = _copied_metals(evidence, voters, asked, copied_regions(copies, of_triangle, asked, known[voters]))
        stay = ~np.isin(known, list(copied))
        known, counted = known[stay], counted[stay]
        evidence = replace(evidence, **{name: values[stay] for name, values in vars(evidence).items()})
        label = _with_fading(pieces, stay, evidence, joined(evidence))
        materials = int(label.max(initial=-1)) + 1
        part_of[known] = label + 1
        metals = _metals(evidence, label, counted)
    others = np.setdiff1d(present, known)
    part_of[others] = materials + 1 + np.arange(len(others))
    return RegroupedParts([part_of[own] for own in regions], materials, _with_others(metals, part_of, others, copied))


def _voters(evidence: MaterialEvidence, counted: np.ndarray) -> np.ndarray:
    """(R,) bool: regions that judge a material by pixels that speak for all of the region, or clearly by a few."""
    return (counted | evidence.metal) & (evidence.left > 0).any(axis=1)


def _copied_metals(
    evidence: MaterialEvidence, voters: np.ndarray, asked: np.ndarray, copies: np.ndarray
) -> dict[int, float]:
    """Roughness of the ``asked`` regions (K,), of which no pixel tells, that are metal as their copies are, by id.

    The ``voters`` (R,) bool vote by their pixels. ``copies`` (2, N) are pairs of an asked region and a voter, as
    numbers into these.
    """
    if not voters.any() or not len(asked):
        return {}
    left, pixels, metal = evidence.left[voters], evidence.pixels[voters], evidence.metal[voters]
    trial = best_trials(left, left[metal].sum(axis=0), slice(HALF, None)) - HALF
    shape = len(asked), HALF
    of_metal, of_all = (votes_of_copies(copies, trial, votes, shape) for votes in (pixels * metal, pixels))
    chosen = np.flatnonzero(2 * of_metal.sum(axis=1) > of_all.sum(axis=1))
    return {int(asked[k]): ROUGHNESS[of_metal[k].argmax()] for k in chosen}


def _with_others(
    metals: JudgedMetals, part_of: np.ndarray, others: np.ndarray, copied: Mapping[int, float]
) -> JudgedMetals:
    """The judgement with the parts of ``others``, of which no pixel tells: those of ``copied`` are metal.

    The rest is none: the fit looks at pixels beside emitters, too, and would take their light for a reflection.
    """
    roughness = {int(part_of[region]): value for region, value in copied.items()}
    dielectric = {int(part_of[region]) for region in others if region not in copied}
    return JudgedMetals({**metals.roughness, **roughness}, metals.dielectric | dielectric)


def _with_fading(pieces: ColorPieces, stay: np.ndarray, evidence: MaterialEvidence, label: np.ndarray) -> np.ndarray:
    """(K,) int64 material, from 0, of the regions that ``stay`` (R,) bool; of those that fade into each other one.

    ``pieces`` are of all regions; ``evidence`` and ``label`` (K,) of those that stay.
    """
    of_all, metal, variance = np.full(len(stay), -1), np.ones(len(stay), bool), np.ones((len(stay), 3))
    of_all[stay], metal[stay], variance[stay] = label, evidence.metal, evidence.variance
    return np.unique(fading(pieces, of_all, variance, metal)[stay], return_inverse=True)[1].reshape(-1)


def _mostly_counted(shards: Sequence[ObservedShard], regions: Sequence[np.ndarray], known: np.ndarray) -> np.ndarray:
    """(R,) bool: at least half of the pixels of ``known`` regions count; of the others most are beside emitters.

    What a mask hides does not count, either.
    """
    size = int(max(own.max(initial=0) for own in regions)) + 1
    pixels, counted = np.zeros(size, np.int64), np.zeros(size, np.int64)
    for shard, own in zip(shards, regions, strict=True):
        pixels += np.bincount(own, minlength=size)
        counted += np.bincount(own[shard.weight > 0], minlength=size)
    return 2 * counted[known] >= pixels[known]


def _metals(evidence: MaterialEvidence, label: np.ndarray, counted: np.ndarray) -> JudgedMetals:
    """Which parts are metal, and which are not: any metal explains them worse, or no region of it is ``counted``.

    ``label`` (R,) as of `joined`, ``counted`` (R,) as of `_mostly_counted`.
    """
    count = int(label.max()) + 1
    left, products = np.zeros((count, len(TRIALS))), np.zeros((count, len(TRIALS), len(TRIALS)))
    np.add.at(left, label, evidence.left)
    np.add.at(products, label, evidence.products)
    best = best_trials(left, evidence.left[evidence.metal].sum(axis=0), slice(HALF, None))
    metal = np.unique(label[evidence.metal])
    unlike = worse(left, products, best, slice(None, HALF), errors=_NO_METAL_ERRORS)
    beside_emitters = np.bincount(label, counted, count) == 0
    dielectric = np.setdiff1d(np.flatnonzero(unlike | beside_emitters), metal)
    roughness = {int(part) + 1: ROUGHNESS[best[part] - HALF] for part in metal}
    return JudgedMetals(roughness, frozenset((dielectric + 1).tolist()))


def _evidence(
    shards: Sequence[ObservedShard], regions: Sequence[np.ndarray]
) -> tuple[np.ndarray, ColorPieces, MaterialEvidence]:
    """Ids of the regions that pixels tell, (R,), their pieces, and what these tell of them.

    Pixels that a region fills come first: the materials they tell are what is taken off of pixels that regions share.
    """
    center, side = scene_box([shard.samples for shard in shards])

    def measured(pixels: RegionPixels) -> tuple[np.ndarray, ColorPieces, MaterialEvidence]:
        known, place = np.unique(pixels.region, return_inverse=True)
        # the distance of each two regions, and what two trials leave of each; twice, since regions that join change it
        needed = 2 * (4 * len(known) ** 2 + 8 * len(known) * len(TRIALS) ** 2)
        check_memory(needed, "the join of segments", "raise fuse.smallest, or set regroup.ids: none")
        pieces = color_pieces(pixels, place.reshape(-1), len(known), center, side)
        return known, pieces, measure(pieces, len(known))

    pixels = region_pixels(shards, regions)
    known, pieces, evidence = measured(pixels)
    if len(known) == 0:
        return known, pieces, evidence
    materials = BestMaterials.of(known, pieces, evidence, center, side)
    return measured(pixels.with_others(shared_pixels(shards, regions, materials.radiance)))


def with_likely_metals(evidence: MaterialEvidence, counted: np.ndarray) -> MaterialEvidence:
    """The evidence with other regions counted as metal: those that have the colour of a metal that the room proves.

    A weak proof of a colour that much paint has proves none. The metal explains them better than any dielectric. Where
    it alone has this colour in the room, it may explain them worse, by no more than one standard error; but not those
    that prove to be dielectric, nor those that are not ``counted`` (R,), of which a few pixels away from emitters would
    speak for many beside them: bars of a window. Nor do those count that have, as dielectrics, a colour that is more
    common among clear dielectrics: white paint in the dark, where the room has much white paint.
    """
    evidence = _without_common_paint(evidence)
    metal, left = evidence.metal.copy(), evidence.left
    no_metal = is_dielectric(left, evidence.judged, evidence.usual)
    dielectric = left[:, :HALF].min(axis=1)
    for k in np.flatnonzero(evidence.metal):
        trial = HALF + int(left[k, HALF:].argmin())
        off = evidence.color[:, trial] - evidence.color[k, trial]
        distance = (off**2 / (evidence.variance + evidence.variance[k])).sum(axis=1)
        metal |= (distance < CHI_SQUARE) & (left[:, trial] < dielectric)
        as_metal = left, evidence.products, np.full(len(left), trial), slice(None, HALF)
        refused, unlikely = worse(*as_metal), worse(*as_metal, errors=_LIKELY_ERRORS)
        for furthest, proof in _WINDOWS:
            same = distance < furthest
            if _metal_alone(evidence, same, refused, proof):
                metal |= same & ~unlikely & ~no_metal & counted
    likely = np.flatnonzero(metal & ~evidence.metal)
    as_paint, as_metal = _pixels_of_color(evidence, likely, np.flatnonzero(~metal))
    metal[likely] = as_paint <= as_metal
    return replace(evidence, metal=metal)


def _without_common_paint(evidence: MaterialEvidence) -> MaterialEvidence:
    """The evidence without metals that noise may have made, and that are far more likely of a paint of the room.

    The best dielectric is no worse than chance allows, and has a colour that `_COMMON` times as many pixels have as a
    dielectric than have the region's as a metal, its own among them: one tile of a hundred.
    """
    dielectrics = np.flatnonzero(~evidence.metal)
    best = best_trials(evidence.left, evidence.left[dielectrics].sum(axis=0), slice(None, HALF))
    weak = np.flatnonzero(evidence.metal & ~worse(evidence.left, evidence.products, best, slice(HALF, None)))
    as_paint, as_metal = _pixels_of_color(evidence, weak, dielectrics)
    metal = evidence.metal.copy()
    metal[weak] = as_paint <= _COMMON * as_metal
    return replace(evidence, metal=metal)


def _pixels_of_color(
    evidence: MaterialEvidence, asked: np.ndarray, others: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How many pixels have the colour of the ``asked`` regions (K,) as dielectrics, and as metals, (K,) float64 each.

    Those are pixels of regions among the ``others`` that are clearly no metal, and of those that prove a metal. Each
    counts by how likely it is that both have one colour.
    """
    left, trials = evidence.left, (slice(None, HALF), slice(HALF, None))
    proved = np.flatnonzero(evidence.metal)
    best = [best_trials(left, left[of].sum(axis=0), kind) for of, kind in zip((others, proved), trials, strict=True)]
    refused = worse(left[others], evidence.products[others], best[1][others], trials[0])
    found = []
    for kind, trial in ((others[refused], best[0][asked, None]), (proved, best[1][None, proved])):
        off = evidence.color[asked[:, None], trial] - evidence.color[kind[None], trial]
        variance = evidence.variance[asked, None] + evidence.variance[None, kind]
        found.append(np.exp(-0.5 * (off**2 / variance).sum(axis=2)) @ evidence.pixels[kind])
    return found[0], found[1]


def _metal_alone(evidence: MaterialEvidence, same: np.ndarray, refused: np.ndarray, proof: float) -> bool:
    """Whether metal alone has a colour, by the regions of it, (R,) bool, and by those that are clearly no such metal.

    Two regions prove it: one of hundreds may by chance. Of the pixels that tell, hardly more than chance are clearly
    dielectric. Those that prove it are more than ``proof`` of those that do not tell: else much would rest on little.
    """
    pixels, proves = evidence.pixels, same & evidence.metal
    others = same & ~evidence.metal
    proved, dielectric = pixels[proves].sum(), pixels[others & refused].sum()
    few_dielectric = dielectric <= _CHANCE * (proved + dielectric)
    undecided = pixels[others & ~refused].sum()
    return bool((proves & ~refused).sum() > 1 and few_dielectric and proved > proof * undecided)


def joined(evidence: MaterialEvidence) -> np.ndarray:
    """(R,) int64 material of each region, from 0 in the order in which their first regions are numbered.

    The two that differ the least join, again and again, until no two agree. So two whites part where there are two,
    whichever is met first.
    """
    materials = _Materials(evidence)
    count = len(evidence.pixels)
    label, alive = np.arange(count), np.arange(count)
    distance = np.full((count, count), np.inf, np.float32)
    for k in range(count):
        distance[:k, k] = distance[k, :k] = materials.distances(k, alive[:k])
    nearest = distance.argmin(axis=1)
    while len(alive):
        least = distance[alive, nearest[alive]]
        own = alive[least.argmin()]
        other = nearest[own]
        if not np.isfinite(least.min()):
            break
        materials.join(own, other)
        label[label == other] = own
        distance[other] = distance[:, other] = np.inf
        alive = alive[alive != other]
        others = alive[alive != own]
        distance[own, others] = distance[others, own] = materials.distances(own, others)
        nearer = others[distance[others, own] < distance[others, nearest[others]]]
        nearest[nearer] = own
        lost = alive[(nearest[alive] == own) | (nearest[alive] == other) | (alive == own)]
        nearest[lost] = distance[lost].argmin(axis=1)
    return np.unique(label, return_inverse=True)[1].reshape(-1)


class _Materials:
    """The evidence of regions that become materials: of one that joined others, the sum."""

    def __init__(self, evidence: MaterialEvidence) -> None:
        self._left, self._products = evidence.left.copy(), evidence.products.copy()
        self._color, self._variance = evidence.color.copy(), evidence.variance.copy()
        self._pixels, self._metal = evidence.pixels.copy(), evidence.metal
        self._of_kind = [evidence.left[of_kind].sum(axis=0) for of_kind in (~evidence.metal, evidence.metal)]

    def distances(self, k: int, others: np.ndarray) -> np.ndarray:
        """(K,) squared distance of the colours of ``k`` and of ``others`` (K,), in variances; inf: they disagree."""
        result = np.full(len(others), np.inf)
        at = np.flatnonzero(self._metal[others] == self._metal[k])
        like = others[at]
        trials = slice(HALF, None) if self._metal[k] else slice(None, HALF)
        best = best_trials(self._left[like] + self._left[k], self._of_kind[int(self._metal[k])], trials)
        off = self._color[like, best] - self._color[k, best]
        difference = (off**2 / (self._variance[like] + self._variance[k])).sum(axis=1)
        near = difference < CHI_SQUARE
        at, like, best = at[near], like[near], best[near]
        same = np.full(len(like), k)
        agrees = ~worse(self._left[like], self._products[like], best, trials)
        agrees &= ~worse(self._left[same], self._products[same], best, trials)
        result[at[agrees]] = difference[near][agrees]
        return result

    def join(self, own: int, other: int) -> None:
        """Let ``other`` become part of ``own``; colours weigh by their pixels."""
        share = self._pixels[other] / (self._pixels[own] + self._pixels[other])
        self._color[own] += share * (self._color[other] - self._color[own])
        self._variance[own] = (1 - share) ** 2 * self._variance[own] + share**2 * self._variance[other]
        for total in (self._left, self._products, self._pixels):
            total[own] += total[other]
