"""Which triangles emit, and how much (method.md, stage 2)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.review import Decisions, numbers
from fipt.scene.samples import FootprintSamples
from fipt.scene.shading import Shading, brightest_reflection
from fipt.stages.emitters.settings import EmittersSettings

INTERIOR = 0.9
"""Share of its pixel that a hit must cover to tell a triangle's own radiance."""
_GAIN = 1.5
"""How much brighter than the brightest reflector an emitter must be."""
_WHOLE = 0.7
"""Share of a part's seen area that must emit before its unseen side is taken to emit too."""
_BRIGHTEST = 0.9
"""Quantile of the bounds of a clipped lamp that stands for its radiance; the last tenth may be sharpened edges."""
_SAME_RADIANCE = 0.35
"""Relative difference up to which neighbouring triangles belong to one lamp."""


@dataclass(frozen=True)
class Decided:
    """What a person decided about triangles.

    Attributes
    ----------
    lamp
        (T,) int32 number of the accepted lamp of a triangle, -1 for all others.
    rejected
        (T,) bool, never emit.
    merged
        Triangles of lamps that are one lamp.
    """

    lamp: np.ndarray
    rejected: np.ndarray
    merged: tuple[np.ndarray, ...] = ()

    @staticmethod
    def of(decisions: Decisions, triangles: int) -> "Decided":
        """Decisions about a mesh of so many triangles."""

        def rows(*texts: str) -> np.ndarray:
            return np.array(sorted(t for text in texts for t in numbers(text, triangles)), np.int64)

        lamp, rejected = np.full(triangles, -1, np.int32), np.zeros(triangles, bool)
        for number, text in enumerate(decisions.accept):
            lamp[rows(text)] = number
        rejected[rows(*decisions.reject)] = True
        return Decided(lamp, rejected, tuple(rows(*group) for group in decisions.merge))


def extract(
    mesh: Mesh,
    shards: list[FootprintSamples],
    shading: Sequence[Shading | np.ndarray],
    images: list[tuple[np.ndarray, np.ndarray]],
    query_mask: Callable[[np.ndarray], np.ndarray],
    settings: EmittersSettings,
    clipped: list[np.ndarray] | None = None,
    decisions: Decisions | None = None,
) -> Emitters:
    """Find the emitting triangles.

    A triangle emits where the mask, averaged over points of it, exceeds the threshold and, with ``evidence``, where
    pixels that it fills are brighter than any reflectance would be under the shading there. Triangles that no pixel
    sees are dropped, unless ``complete`` and their part glows wherever it is seen. One view at a time is in memory, and
    the pixels of triangles that may emit.

    Parameters
    ----------
    shading
        (H, outputs, 3) of each shard.
    images
        Per shard: (P, 3) radiance and (P,) weight.
    query_mask
        (N, 3) points -> (N,) emission mask.
    clipped
        Per shard: (P,) bool, pixels whose radiance is only a lower bound; None: there are none.
    decisions
        Lamps that a person accepted (they emit whatever the pictures say, each by itself), rejected and merged.
    """
    decided = Decided.of(decisions or Decisions(), len(mesh.triangles))
    pixels = partial(_pixels, shards, shading, images, clipped)
    observed, bright = (np.zeros(len(mesh.triangles), np.int64) for _ in range(2))
    for triangle, _, _, ratio, _ in pixels():
        observed += np.bincount(triangle, minlength=len(observed))
        bright += np.bincount(triangle[ratio > _GAIN], minlength=len(observed))
    seen = np.flatnonzero(observed)
    if settings.evidence:
        # the mask network is asked only where the light could not be reflected: a median above needs half above
        triangle, _, _, ratio, _ = _of_triangles(pixels(), (observed > 0) & (2 * bright >= observed))
        seen, index = np.unique(triangle, return_inverse=True)
        seen = seen[_grouped_median(ratio, index, len(seen)) > _GAIN]
    emitting = np.zeros(len(observed), bool)
    emitting[seen[_mean_mask(mesh, seen, query_mask, settings) > settings.threshold]] = True
    emitting = (emitting | (decided.lamp >= 0)) & ~decided.rejected
    triangle, radiance, view, _, bound = _of_triangles(pixels(), emitting)
    chosen, index = np.unique(triangle, return_inverse=True)
    found = _measured(mesh, chosen, index, radiance, view, bound, decided, settings)
    return _completed(mesh, found, np.flatnonzero(observed), decided, settings.complete)


Observations = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of pixels: triangle, radiance (N, 3), number of the view, radiance over the most that could be reflected, and
whether the radiance is only a lower bound.
"""


def _pixels(
    shards: list[FootprintSamples],
    shading: Sequence[Shading | np.ndarray],
    images: list[tuple[np.ndarray, np.ndarray]],
    clipped: list[np.ndarray] | None,
) -> Iterator[Observations]:
    """Yield the pixels of every view that one triangle's piece fills."""
    number = 0
    clipped = clipped or [np.zeros(len(valid), bool) for _, valid in images]
    for samples, baked, (image, valid), above in zip(shards, shading, images, clipped, strict=True):
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            use = np.flatnonzero((samples.weight[own] >= INTERIOR) & (valid[pixel] > 0))
            light = np.asarray(baked[own], np.float32)[use]
            seen = np.asarray(image[pixel[use]])
            triangle = np.asarray(samples.triangle[own])[use]
            yield (
                triangle,
                seen,
                np.full(len(use), number),
                seen.mean(axis=1) / (brightest_reflection(light) + 1e-4),
                above[pixel[use]],
            )
            number += 1


def _of_triangles(pixels: Iterator[Observations], chosen: np.ndarray) -> Observations:
    """Observations of the triangles where ``chosen`` (T,) is true, all views together."""
    parts = [[values[chosen[view[0]]] for values in view] for view in pixels]
    return tuple(np.concatenate(values) for values in zip(*parts, strict=True))


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


def _measured(
    mesh: Mesh,
    triangles: np.ndarray,
    index: np.ndarray,
    radiance: np.ndarray,
    view: np.ndarray,
    bound: np.ndarray,
    decided: Decided,
    settings: EmittersSettings,
) -> Emitters:
    """Median radiance of every triangle; with ``patches`` one radiance for each connected lamp."""
    own, unknown = _levels(radiance, bound, index, len(triangles))
    lamp = _lamps(mesh, triangles, own, decided)
    group = lamp[index]
    lamps = int(lamp.max(initial=-1)) + 1
    level, unknown_lamp = _levels(radiance, bound, group, lamps)
    clipped = np.bincount(group, bound, lamps) / np.maximum(np.bincount(group, minlength=lamps), 1)
    spread = np.abs(radiance.mean(axis=1) / np.maximum(level.mean(axis=1)[group], 1e-6) - 1)
    agreement = np.exp(-_grouped_median(spread, group, lamps) / 0.1)
    seen_by = np.zeros(lamps, np.int64)
    np.add.at(seen_by, np.unique(np.stack([group, view]), axis=1)[0], 1)
    confidence = agreement * (1 - np.exp(-seen_by / 2))
    return Emitters(
        triangle=triangles.astype(np.int32),
        radiance=(level[lamp] if settings.patches else own).astype(np.float32),
        area=mesh.areas[triangles].astype(np.float32),
        emitter=lamp.astype(np.int32),
        views=seen_by[lamp].astype(np.int32),
        confidence=confidence[lamp].astype(np.float32),
        clipped=clipped[lamp].astype(np.float32),
        lower_bound=unknown_lamp[lamp] if settings.patches else unknown,
        two_sided=settings.two_sided,
    )


def _completed(mesh: Mesh, found: Emitters, observed: np.ndarray, decided: Decided, complete: bool) -> Emitters:
    """Add triangles that no pixel shows alone: of accepted lamps, and, with ``complete``, a globe's far side.

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
    # an accepted lamp is a part of its own
    part = np.where(decided.lamp >= 0, count + decided.lamp, part)
    hidden = np.flatnonzero((hidden | (decided.lamp >= 0) & ~emits) & np.isin(part, part[found.triangle]))
    if len(hidden) == 0:
        return found
    # each takes after the nearest emitting triangle of its part
    centers = mesh.corners.mean(axis=1)
    apart = 4 * float(np.ptp(mesh.vertices, axis=0).max() + 1)
    place = np.concatenate([centers, part[:, None] * apart], axis=1)
    _, like = cKDTree(place[found.triangle]).query(place[hidden])
    triangle = np.concatenate([found.triangle, hidden.astype(np.int32)])
    order = np.argsort(triangle)
    rows = np.concatenate([np.arange(len(found.triangle)), like])[order]
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


def _lamps(mesh: Mesh, triangles: np.ndarray, radiance: np.ndarray, decided: Decided) -> np.ndarray:
    """(E,) number of the lamp of each triangle: triangles that share a vertex and are about as bright.

    An accepted lamp is one, and no other triangle belongs to it; then merged lamps become one.
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
    accepted = decided.lamp[triangles]
    alike &= accepted[a] == accepted[b]
    whole = [np.flatnonzero(accepted == lamp) for lamp in np.unique(accepted[accepted >= 0])]
    lamp = _connected([np.stack([a, b])[:, alike], *map(_chain, whole)], len(triangles))
    merged = [np.unique(lamp[np.isin(triangles, group)]) for group in decided.merged]
    return _connected([np.empty((2, 0), int), *map(_chain, merged)], int(lamp.max()) + 1)[lamp]


def _chain(nodes: np.ndarray) -> np.ndarray:
    """(2, N - 1) edges that connect N nodes."""
    return np.stack([nodes[:-1], nodes[1:]])


def _connected(edges: list[np.ndarray], nodes: int) -> np.ndarray:
    """(nodes,) component of each node, by the order of their first ones; edges are (2, N) each."""
    a, b = np.concatenate(edges, axis=1)
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    return connected_components(graph, directed=False)[1].astype(np.int64)
