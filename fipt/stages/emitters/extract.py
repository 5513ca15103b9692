"""Which triangles emit, and how much (method.md, stage 2)."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fipt.conventions import EMITTER_GAIN
from fipt.model.reflectance import brightest_reflection
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.scene.review import ReviewDecisions, numbers
from fipt.stages.emitters.settings import EmittersSettings

INTERIOR = 0.9
"""Share of its pixel that a sample must cover to tell a triangle's own radiance."""
_WHOLE = 0.7
"""Share of a part's seen area that must emit before its unseen side is taken to emit too."""
_BRIGHTEST = 0.9
"""Quantile of the bounds of a clipped emitter that stands for its radiance; the last tenth may be sharpened edges."""
_SAME_RADIANCE = 0.35
"""Relative difference up to which neighbouring triangles belong to one emitter."""


@dataclass(frozen=True)
class Decided:
    """What a person decided about triangles.

    Attributes
    ----------
    emitter
        (T,) int32 number of the accepted emitter of a triangle, -1 for all others.
    rejected
        (T,) bool, never emit.
    merged
        Triangles of emitters that are one emitter.
    """

    emitter: np.ndarray
    rejected: np.ndarray
    merged: tuple[np.ndarray, ...] = ()

    @staticmethod
    def of(decisions: ReviewDecisions, triangles: int) -> "Decided":
        """ReviewDecisions about a mesh of so many triangles."""

        def rows(*texts: str) -> np.ndarray:
            return np.array(sorted(t for text in texts for t in numbers(text, triangles)), np.int64)

        emitter, rejected = np.full(triangles, -1, np.int32), np.zeros(triangles, bool)
        for number, text in enumerate(decisions.accept):
            emitter[rows(text)] = number
        rejected[rows(*decisions.reject)] = True
        return Decided(emitter, rejected, tuple(rows(*group) for group in decisions.merge))


def extract(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    query_mask: Callable[[np.ndarray], np.ndarray],
    settings: EmittersSettings,
    decisions: ReviewDecisions | None = None,
) -> Emitters:
    """Find the emitting triangles.

    A triangle emits where the mask, averaged over points of it, exceeds the threshold and, with ``evidence``, where
    pixels that it fills are brighter than any reflectance would be under the shading there. Triangles that no pixel
    sees are dropped, unless ``complete`` and their part glows wherever it is seen. One view at a time is in memory, and
    the pixels of triangles that may emit.

    Parameters
    ----------
    shards
        The training views.
    query_mask
        (N, 3) points -> (N,) emission mask.
    decisions
        Emitters that a person accepted (they emit whatever the photographs say, each by itself), rejected and merged.
    """
    decided = Decided.of(decisions or ReviewDecisions(), len(mesh.triangles))
    observed, bright = (np.zeros(len(mesh.triangles), np.int64) for _ in range(2))
    for view in _observations(shards):
        observed += np.bincount(view.triangle, minlength=len(observed))
        bright += np.bincount(view.triangle[view.ratio > EMITTER_GAIN], minlength=len(observed))
    seen = np.flatnonzero(observed)
    if settings.evidence:
        # the mask network is asked only where the light could not be reflected: a median above needs half above
        found = _of_triangles(_observations(shards), (observed > 0) & (2 * bright >= observed))
        seen, index = np.unique(found.triangle, return_inverse=True)
        seen = seen[_grouped_median(found.ratio, index, len(seen)) > EMITTER_GAIN]
    emitting = np.zeros(len(observed), bool)
    emitting[seen[_mean_mask(mesh, seen, query_mask, settings) > settings.threshold]] = True
    emitting = (emitting | (decided.emitter >= 0)) & ~decided.rejected
    measured = _measured(mesh, _of_triangles(_observations(shards), emitting), decided, settings)
    return _completed(mesh, measured, np.flatnonzero(observed), decided, settings.complete)


@dataclass(frozen=True)
class Observations:
    """N pixels that one triangle's piece fills.

    Attributes
    ----------
    triangle, view
        (N,) int64: the triangle, and the number of the view.
    radiance
        (N, 3) observed.
    ratio
        (N,) radiance over the most that could be reflected.
    clipped
        (N,) bool: the radiance is only a lower bound.
    """

    triangle: np.ndarray
    radiance: np.ndarray
    view: np.ndarray
    ratio: np.ndarray
    clipped: np.ndarray


def _observations(shards: Sequence[ObservedShard]) -> Iterator[Observations]:
    """Yield the pixels of every view that one triangle's piece fills."""
    number = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            use = np.flatnonzero((samples.weight[own] >= INTERIOR) & (shard.weight[pixel] > 0))
            shading = np.asarray(shard.shading[own], np.float32)[use]
            radiance = np.asarray(shard.radiance[pixel[use]])
            yield Observations(
                np.asarray(samples.triangle[own])[use],
                radiance,
                np.full(len(use), number),
                radiance.mean(axis=1) / brightest_reflection(shading),
                shard.clipped[pixel[use]],
            )
            number += 1


def _of_triangles(views: Iterable[Observations], chosen: np.ndarray) -> Observations:
    """Observations of the triangles where ``chosen`` (T,) is true, all views together."""
    parts = [[values[chosen[view.triangle]] for values in vars(view).values()] for view in views]
    return Observations(*(np.concatenate(values) for values in zip(*parts, strict=True)))


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
        root = np.sqrt(u[..., :1])
        a, b, c = (corners[:, None, k] for k in range(3))
        points = a * (1 - root) + b * (root * (1 - u[..., 1:])) + c * (root * u[..., 1:])
        mask = query_mask(points.reshape(-1, 3).astype(np.float32))
        result[start : start + chunk] = mask.reshape(len(corners), -1).mean(axis=1)
    return result


def _grouped_median(values: np.ndarray, index: np.ndarray, groups: int) -> np.ndarray:
    """(groups,) median of ``values`` (N,) per group; every group must have a member."""
    return _grouped_quantile(values, index, groups, 0.5)


def _grouped_quantile(values: np.ndarray, index: np.ndarray, groups: int, share: float) -> np.ndarray:
    """(groups,) quantile of ``values`` (N,) per group: the mean of the two members around it."""
    order = np.lexsort((values, index))
    count = np.bincount(index, minlength=groups)
    start = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    place, ordered = share * (count - 1), values[order]
    return 0.5 * (ordered[start + np.floor(place).astype(np.int64)] + ordered[start + np.ceil(place).astype(np.int64)])


def _levels(radiance: np.ndarray, bound: np.ndarray, index: np.ndarray, groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Median radiance (groups, 3) of each group, and whether (groups,) that is only a lower bound.

    A clipped pixel below the median of what was measured agrees with it and counts as much. Where at least half of the
    pixels are bounds above it, nobody knows the radiance: the brightest bounds come nearest.
    """
    measured, inverse = np.unique(index[~bound], return_inverse=True)
    least = np.zeros((groups, 3))
    for c in range(3):
        least[measured, c] = _grouped_median(radiance[~bound, c], inverse, len(measured))
    above = bound & (radiance.mean(axis=1) > least[index].mean(axis=1))
    unknown = 2 * np.bincount(index, above, groups) >= np.maximum(np.bincount(index, minlength=groups), 1)
    raised = np.where(bound[:, None], np.maximum(radiance, least[index]), radiance)
    level = np.stack([_grouped_median(raised[:, c], index, groups) for c in range(3)], axis=1).reshape(-1, 3)
    bounds = above & unknown[index]
    clipped, inverse = np.unique(index[bounds], return_inverse=True)
    for c in range(3):
        level[clipped, c] = _grouped_quantile(radiance[bounds, c], inverse, len(clipped), _BRIGHTEST)
    return level, unknown


def _measured(mesh: Mesh, seen: Observations, decided: Decided, settings: EmittersSettings) -> Emitters:
    """Median radiance of every triangle; with ``patches`` one radiance for each connected emitter."""
    triangles, index = np.unique(seen.triangle, return_inverse=True)
    own, unknown = _levels(seen.radiance, seen.clipped, index, len(triangles))
    emitter = _connected_emitters(mesh, triangles, own, decided)
    group = emitter[index]
    count = int(emitter.max(initial=-1)) + 1
    level, unknown_level = _levels(seen.radiance, seen.clipped, group, count)
    clipped = np.bincount(group, seen.clipped, count) / np.maximum(np.bincount(group, minlength=count), 1)
    spread = np.abs(seen.radiance.mean(axis=1) / np.maximum(level.mean(axis=1)[group], 1e-6) - 1)
    agreement = np.exp(-_grouped_median(spread, group, count) / 0.1)
    seen_by = np.zeros(count, np.int64)
    np.add.at(seen_by, np.unique(np.stack([group, seen.view]), axis=1)[0], 1)
    confidence = agreement * (1 - np.exp(-seen_by / 2))
    return Emitters(
        triangle=triangles.astype(np.int32),
        radiance=(level[emitter] if settings.patches else own).astype(np.float32),
        area=mesh.areas[triangles].astype(np.float32),
        emitter=emitter.astype(np.int32),
        views=seen_by[emitter].astype(np.int32),
        confidence=confidence[emitter].astype(np.float32),
        clipped=clipped[emitter].astype(np.float32),
        lower_bound=unknown_level[emitter] if settings.patches else unknown,
        two_sided=settings.two_sided,
    )


def _completed(mesh: Mesh, found: Emitters, observed: np.ndarray, decided: Decided, complete: bool) -> Emitters:
    """Add triangles that no pixel shows alone: of accepted emitters, and, with ``complete``, a globe's far side.

    That is the rest of a connected part that glows wherever it is seen.
    """
    part = connected_parts(mesh)
    emits, visible = np.zeros(len(part), bool), np.zeros(len(part), bool)
    emits[found.triangle] = True
    visible[observed] = True
    areas, count = mesh.areas, int(part.max()) + 1
    glowing = np.bincount(part, areas * emits, count)
    whole = (glowing > 0) & (glowing >= _WHOLE * np.bincount(part, areas * (visible | emits), count))
    hidden = whole[part] & ~visible & ~emits & ~decided.rejected if complete else np.zeros(len(part), bool)
    # an accepted emitter is a part of its own
    part = np.where(decided.emitter >= 0, count + decided.emitter, part)
    hidden = np.flatnonzero((hidden | (decided.emitter >= 0) & ~emits) & np.isin(part, part[found.triangle]))
    if len(hidden) == 0:
        return found
    # each takes after the nearest emitting triangle of its part
    centers = mesh.corners.mean(axis=1)
    far = 4 * float(np.ptp(mesh.vertices, axis=0).max() + 1)
    place = np.concatenate([centers, part[:, None] * far], axis=1)
    _, nearest = cKDTree(place[found.triangle]).query(place[hidden])
    triangle = np.concatenate([found.triangle, hidden.astype(np.int32)])
    order = np.argsort(triangle)
    rows = np.concatenate([np.arange(len(found.triangle)), nearest])[order]
    return Emitters(
        triangle=triangle[order],
        radiance=found.radiance[rows],
        area=areas[triangle[order]].astype(np.float32),
        emitter=found.emitter[rows],
        views=found.views[rows],
        confidence=found.confidence[rows],
        clipped=found.clipped[rows],
        lower_bound=found.lower_bound[rows],
        two_sided=found.two_sided,
    )


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


def _chain(nodes: np.ndarray) -> np.ndarray:
    """(2, N - 1) edges that connect N nodes."""
    return np.stack([nodes[:-1], nodes[1:]])


def _connected(edges: list[np.ndarray], nodes: int) -> np.ndarray:
    """(nodes,) component of each node, by the order of their first ones; edges are (2, N) each."""
    a, b = np.concatenate(edges, axis=1)
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    return connected_components(graph, directed=False)[1].astype(np.int64)
