"""Which triangles emit, and how much (method.md, Emitters)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.conventions import EMITTER_GAIN
from fipt.groups import connected_groups
from fipt.scene.emitters import Emitters, Undecided
from fipt.scene.mesh import Mesh, points_of
from fipt.scene.observed import ObservedShard
from fipt.scene.review import ReviewDecisions
from fipt.stages.emitters.completion import Seen, completed
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.emitter_copies import with_copies
from fipt.stages.emitters.fragments import LEAST_DIFFERENCE, SIGMA, same_emitters
from fipt.stages.emitters.hypotheses import RegionEvidence, judge
from fipt.stages.emitters.mixed import mixed_emitters
from fipt.stages.emitters.observations import (
    Observations,
    grouped_median,
    levels,
    observations,
    of_triangles,
    standard_errors,
)
from fipt.stages.emitters.regions import Surface, find_regions
from fipt.stages.emitters.settings import EmittersSettings
from fipt.stages.emitters.shape import shaped
from fipt.stages.emitters.sides import emitting_sides
from fipt.stages.emitters.small import RELEVANT, small_emitters

_MOST_PIXELS = 4_000_000
"""Pixels used at most to find regions: medians do not need more."""
_MOST_UNDECIDED = 20
"""Regions that are asked about at most."""
_PIXELS_OF_TEXEL = 9
"""Pixels that a triangle needs for its median to count as a texel."""
_SAME_RADIANCE = 0.35
"""Relative difference up to which neighbouring triangles belong to one emitter."""


@dataclass(frozen=True)
class Extracted:
    """What emits, as the views show it.

    Attributes
    ----------
    emitters
        Emitting triangles.
    doubtful
        Regions that emit because they are brighter than white under the light that is known, or more even. A lamp
        nearby that nobody sees would explain them, too.
    """

    emitters: Emitters
    doubtful: Undecided

    @property
    def in_doubt(self) -> np.ndarray:
        """(E,) bool: triangles of emitters of which more than half of the power is doubtful; a rim is not."""
        found = self.emitters
        power = found.area * found.radiance.mean(axis=1)
        asked = np.isin(found.triangle, self.doubtful.triangle)
        return (2 * np.bincount(found.emitter, power * asked) > np.bincount(found.emitter, power))[found.emitter]


def extract(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    query_mask: Callable[[np.ndarray], np.ndarray] | None,
    settings: EmittersSettings,
    decisions: ReviewDecisions | None = None,
) -> Extracted:
    """Find the emitting triangles.

    With ``decide: regions`` a region of like radiance emits where emission explains what all views show of it better
    than any material does (`fipt.stages.emitters.hypotheses`). With ``decide: mask`` a triangle emits where the mask,
    averaged over points of it, exceeds the threshold and, with ``evidence``, where pixels that it fills are brighter
    than any reflectance would be under the shading there. Triangles that no pixel sees are dropped, unless
    ``complete`` and their part glows wherever it is seen; so are those that are seen dark from behind, and those that
    close an emitter around them (`fipt.stages.emitters.completion`).

    Parameters
    ----------
    shards
        The training views.
    query_mask
        (N, 3) points -> (N,) emission mask; None with ``decide: regions``.
    decisions
        Emitters that a person accepted (they emit whatever the photographs say, each by itself), rejected and merged.
    """
    decided = Decided.of(decisions or ReviewDecisions(), len(mesh.triangles))
    undecided, surface, doubtful = Undecided.none(), None, Undecided.none()
    views: Iterable[Observations]
    if settings.decide == "regions":
        seen = _all_pixels(mesh, shards)
        surface = find_regions(mesh, shards, seen)
        evidence = judge(shards, seen, surface)
        label = shaped(mesh, surface, evidence.emitting(surface.touching), shards)
        asked = (label >= 0) & (decided.emitter < 0) & ~decided.rejected & ~np.append(evidence.certain, False)[label]
        doubtful = _regions(np.where(asked, label, -1), np.unique(label[asked]), evidence)
        tells = label == surface.region  # a rim has the light of the region inside, but mixed with what is around
        small = small_emitters(mesh, shards, surface, label >= 0, decided.rejected | (decided.emitter >= 0))
        label, few = np.where(small.number >= 0, surface.count + small.number, label), small.number >= 0
        seen = Observations.joined([seen[~few[seen.triangle]], small.pixels])
        seen, tells = seen[np.argsort(seen.view, kind="stable")], tells | few
        shown = Seen(surface.pixels > 0, small.seen_dark, surface.radiance)
        undecided = _undecided(mesh, surface, evidence, label, decided)
        first, views = surface.count + int(small.number.max(initial=-1)) + 1, [seen]
    else:
        assert query_mask is not None
        emitting, shown = _masked(mesh, shards, query_mask, settings)
        label = np.where(emitting, np.arange(len(emitting)), -1)
        tells, first, views = np.ones(len(label), bool), len(label), observations(shards)
    label = np.where(decided.emitter >= 0, first + decided.emitter, label)
    label[decided.rejected] = -1
    tells = (label >= 0) & (tells | (decided.emitter >= 0))
    measured = _measured(mesh, of_triangles(views, tells), label, decided, settings, surface)
    found = completed(mesh, shards, measured, shown, settings, decided)
    if settings.sides == "seen":
        found = replace(found, sides=emitting_sides(mesh, found, shards))
    accepted = np.isin(found.emitter, found.emitter[decided.emitter[found.triangle] >= 0])
    doubtful = doubtful.of(np.setdiff1d(doubtful.triangle, found.triangle[accepted]))
    if settings.complete:
        found = with_copies(mesh, shards, found, doubtful.triangle, shown, decided, settings.guess)
    return Extracted(replace(found, undecided=undecided), doubtful)


def _all_pixels(mesh: Mesh, shards: Sequence[ObservedShard]) -> Observations:
    """Pixels of all views that one piece of surface fills, every n-th where there are too many; sorted by view.

    With them those from which an emitter's light is told that others stand before.
    """
    total = sum(int(shard.samples.first_pixels[-1]) for shard in shards)
    step = max(total // _MOST_PIXELS, 1)
    alone = Observations.joined(view[::step] for view in observations(shards, ratios=False))
    seen = Observations.joined([alone, mixed_emitters(mesh, shards)[::step]])
    return seen[np.argsort(seen.view, kind="stable")]


def _masked(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    query_mask: Callable[[np.ndarray], np.ndarray],
    settings: EmittersSettings,
) -> tuple[np.ndarray, Seen]:
    """Which triangles (T,) the mask says to emit, and what a pixel shows alone."""
    observed, bright = (np.zeros(len(mesh.triangles), np.int64) for _ in range(2))
    for view in observations(shards):
        observed += np.bincount(view.triangle, minlength=len(observed))
        bright += np.bincount(view.triangle[view.ratio > EMITTER_GAIN], minlength=len(observed))
    seen = np.flatnonzero(observed)
    if settings.evidence:
        # the mask network is asked only where the light could not be reflected: a median above needs half above
        found = of_triangles(observations(shards), (observed > 0) & (2 * bright >= observed))
        seen, index = np.unique(found.triangle, return_inverse=True)
        seen = seen[grouped_median(found.ratio, index, len(seen)) > EMITTER_GAIN]
    emitting = np.zeros(len(observed), bool)
    emitting[seen[_mean_mask(mesh, seen, query_mask, settings) > settings.threshold]] = True
    count = len(observed)
    return emitting, Seen(observed > 0, np.zeros((count, 2), bool), np.full((count, 3), np.nan))


def _undecided(
    mesh: Mesh, surface: Surface, evidence: RegionEvidence, label: np.ndarray, decided: Decided
) -> Undecided:
    """Regions for which emission is ahead, but not by enough; those whose light would matter, the brightest first."""
    free = (surface.region >= 0) & (label < 0) & (decided.emitter < 0) & ~decided.rejected
    flux = np.nan_to_num(surface.radiance.mean(axis=1)) * mesh.areas
    each = np.bincount(surface.region[free], flux[free], surface.count) * evidence.undecided
    chosen = np.flatnonzero(each > RELEVANT * flux[label >= 0].sum())
    chosen = chosen[np.argsort(-each[chosen])][:_MOST_UNDECIDED]
    return _regions(np.where(free, surface.region, -1), chosen, evidence)


def _regions(region: np.ndarray, chosen: np.ndarray, evidence: RegionEvidence) -> Undecided:
    """What speaks for and against the emission of chosen regions (C,), those of the triangles (T,); -1 is none."""
    number = np.full(len(evidence.price) + 1, -1)
    number[chosen] = np.arange(len(chosen))
    own = number[region]
    triangle = np.flatnonzero(own >= 0)
    costs = (evidence.reflects, evidence.emits, evidence.price)
    return Undecided(
        triangle.astype(np.int32),
        own[triangle].astype(np.int32),
        *(cost[chosen].astype(np.float32) for cost in costs),
    )


def _mean_mask(
    mesh: Mesh,
    triangles: np.ndarray,
    query_mask: Callable[[np.ndarray], np.ndarray],
    settings: EmittersSettings,
) -> np.ndarray:
    """(N,) mask of each triangle, averaged over random points of it; chunks bound the memory."""
    result = np.empty(len(triangles))
    rng = np.random.default_rng(0)
    chunk = max(1_000_000 // settings.points, 1)
    for start in range(0, len(triangles), chunk):
        corners = mesh.corners[triangles[start : start + chunk]]
        u = rng.random((len(corners), settings.points, 2), dtype=np.float32)
        points = points_of(corners[:, None], u[..., 0], u[..., 1])
        mask = query_mask(points.reshape(-1, 3).astype(np.float32))
        result[start : start + chunk] = mask.reshape(len(corners), -1).mean(axis=1)
    return result


def _measured(
    mesh: Mesh,
    seen: Observations,
    label: np.ndarray,
    decided: Decided,
    settings: EmittersSettings,
    surface: Surface | None,
) -> Emitters:
    """Median radiance of every label; with ``patches`` one radiance for each connected emitter.

    Parameters
    ----------
    seen
        Pixels that tell the radiance of what is labelled.
    label
        (T,) what a triangle shares its radiance with, -1 where it does not emit; labels that no pixel tells go.
    surface
        What the views show; None: an emitter is not looked at for a texture.
    """
    labels, index = np.unique(label[seen.triangle], return_inverse=True)
    own, unknown = levels(seen.radiance, seen.clipped, index.reshape(-1), len(labels))
    triangles = np.flatnonzero(np.isin(label, labels) & (label >= 0))
    row = np.searchsorted(labels, label[triangles])
    emitter = _connected_emitters(mesh, triangles, own[row], decided)
    # an island beside an emitter that no pixel shows alone
    shown = np.isin(emitter, emitter[np.isin(triangles, seen.triangle)])
    triangles, row = triangles[shown], row[shown]
    emitter = np.unique(emitter[shown], return_inverse=True)[1].reshape(-1)
    group = emitter[np.searchsorted(triangles, seen.triangle)]
    count = int(emitter.max(initial=-1)) + 1
    if surface is not None:
        emitter = _whole_emitters(mesh, triangles, emitter, seen, surface, decided)
        group, count = emitter[np.searchsorted(triangles, seen.triangle)], int(emitter.max(initial=-1)) + 1
    level, unknown_level = levels(seen.radiance, seen.clipped, group, count)
    error = standard_errors(seen.radiance, seen.view, group, count)
    clipped = np.bincount(group, seen.clipped, count) / np.maximum(np.bincount(group, minlength=count), 1)
    spread = np.abs(seen.radiance.mean(axis=1) / np.maximum(level.mean(axis=1)[group], 1e-6) - 1)
    agreement = np.exp(-grouped_median(spread, group, count) / 0.1)
    seen_by = np.zeros(count, np.int64)
    np.add.at(seen_by, np.unique(np.stack([group, seen.view]), axis=1)[0], 1)
    confidence = agreement * (1 - np.exp(-seen_by / 2))
    found = Emitters(
        triangle=triangles.astype(np.int32),
        radiance=(level[emitter] if settings.patches else own[row]).astype(np.float32),
        area=mesh.areas[triangles].astype(np.float32),
        emitter=emitter.astype(np.int32),
        views=seen_by[emitter].astype(np.int32),
        confidence=confidence[emitter].astype(np.float32),
        clipped=clipped[emitter].astype(np.float32),
        lower_bound=unknown_level[emitter] if settings.patches else unknown[row],
        error=error[emitter].astype(np.float32),
    )
    if surface is None or not settings.patches:
        return found
    merged = emitter[np.isin(triangles, np.concatenate([np.empty(0, np.int64), *decided.merged]))]
    return _textured(found, seen[~np.isin(group, merged)], surface)  # merged emitters have one radiance


def _textured(found: Emitters, seen: Observations, surface: Surface) -> Emitters:
    """The same with the radiance of each triangle where an emitter's triangles differ by more than their pixels' noise.

    Emitters of which no pixel is ``seen`` are left as they are.
    """
    bright = np.log(np.maximum(seen.radiance.mean(axis=1), 1e-9))
    shown, index = np.unique(seen.triangle, return_inverse=True)
    index = index.reshape(-1)
    texel, unknown = levels(seen.radiance, seen.clipped, index, len(shown))
    middle = np.log(np.maximum(texel.mean(axis=1), 1e-9))
    noise = grouped_median(np.abs(bright - middle[index]), index, len(shown))
    error = 1.2533 * noise / np.sqrt(np.maximum(surface.pixels[shown], 1))
    use = surface.pixels[shown] >= _PIXELS_OF_TEXEL
    place = np.searchsorted(found.triangle, shown)
    of, each, limit = found.emitter[place], surface.radiance[found.triangle], found.lower_bound.copy()
    each[place[use]], limit[place[use]] = texel[use], unknown[use]
    radiance, bound = found.radiance.copy(), found.lower_bound.copy()
    for number in np.unique(of[use]):
        own = use & (of == number)
        spread = np.median(np.abs(middle[own] - np.median(middle[own])))
        if spread > max(SIGMA * np.median(error[own]), LEAST_DIFFERENCE):
            known = (found.emitter == number) & np.isfinite(each[:, 0])
            # a rim, blurred with what is dark around, is no darker than the darkest texel
            radiance[known] = np.clip(each[known], texel[own].min(axis=0), texel[own].max(axis=0))
            bound[known] = limit[known]
    return replace(found, radiance=radiance, lower_bound=bound)


def _connected_emitters(mesh: Mesh, triangles: np.ndarray, radiance: np.ndarray, decided: Decided) -> np.ndarray:
    """(E,) number of the emitter of each triangle: triangles that share a vertex and are about as bright.

    An accepted emitter is one, and no other triangle belongs to it; then merged emitters become one.
    """
    if len(triangles) == 0:
        return np.empty(0, np.int64)
    corners = mesh.corners[triangles].reshape(-1, 3)
    _, vertex = np.unique(corners, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1)
    order = np.argsort(vertex, kind="stable")
    owner = np.repeat(np.arange(len(triangles)), 3)[order]
    same = vertex[order][1:] == vertex[order][:-1]
    a, b = owner[:-1][same], owner[1:][same]
    bright = radiance.mean(axis=1)
    alike = np.abs(bright[a] - bright[b]) <= _SAME_RADIANCE * np.maximum(bright[a], bright[b])
    accepted = decided.emitter[triangles]
    alike &= accepted[a] == accepted[b]
    whole = [np.flatnonzero(accepted == number) for number in np.unique(accepted[accepted >= 0])]
    emitter = _connected([np.stack([a, b])[:, alike], *map(_chain, whole)], len(triangles))
    merged = [np.unique(emitter[np.isin(triangles, group)]) for group in decided.merged]
    return _connected([np.empty((2, 0), int), *map(_chain, merged)], int(emitter.max()) + 1)[emitter]


def _whole_emitters(
    mesh: Mesh, triangles: np.ndarray, emitter: np.ndarray, seen: Observations, surface: Surface, decided: Decided
) -> np.ndarray:
    """(E,) number of the emitter of each triangle, fragments of one joined; accepted ones stay by themselves."""
    count = int(emitter.max(initial=-1)) + 1
    group = emitter[np.searchsorted(triangles, seen.triangle)]
    level = levels(seen.radiance, seen.clipped, group, count)[0]
    error = standard_errors(seen.radiance, seen.view, group, count)
    pixel = float(np.median(surface.width[triangles])) if count else 0.0
    pairs = same_emitters(mesh, triangles, emitter, level, error, pixel)
    alone = np.isin(np.arange(count), emitter[decided.emitter[triangles] >= 0])
    return _connected([pairs[:, ~alone[pairs].any(axis=0)]], count)[emitter]


def _chain(nodes: np.ndarray) -> np.ndarray:
    """(2, N - 1) edges that connect N nodes."""
    return np.stack([nodes[:-1], nodes[1:]])


def _connected(edges: list[np.ndarray], nodes: int) -> np.ndarray:
    """(nodes,) component of each node, by the order of their first ones; edges are (2, N) each."""
    a, b = np.concatenate(edges, axis=1)
    return connected_groups((a, b), nodes)
