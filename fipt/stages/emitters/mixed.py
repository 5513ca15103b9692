"""Emitters that hardly a pixel shows alone: a window behind blinds, tubes behind a grille.

Their radiance is told by pixels that show other surface as well (`fipt.scene.mixed`), tile by tile. An island emits if
the tiles of which it is the largest say together that it is brighter by `EMITTER_GAIN` than any reflection, three
standard errors aside. Its pixels are then observations as others are, with the radiance of the island alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from fipt.conventions import EMITTER_GAIN
from fipt.model.reflectance import brightest_reflection
from fipt.scene.mesh import Mesh
from fipt.scene.mixed import Islands, find_islands, unmixed
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.stages.emitters.observations import Observations

_LEAST_SHARE = 0.2
"""Share of a pixel below which it says little of a surface."""
_SIGMAS = 3.0
"""Standard errors by which an island must be brighter than reflections."""
_FEWEST = 3
"""Tiles whose scatter tells an error."""


@dataclass(frozen=True)
class _IslandSamples:
    """N samples of islands whose radiance a tile tells.

    ``island`` and ``tile`` (N,) int64; ``radiance`` (N, 3); ``error``, ``share`` of the pixel and ``most``, the
    brightest reflection, (N,).
    """

    island: np.ndarray
    radiance: np.ndarray
    error: np.ndarray
    tile: np.ndarray
    share: np.ndarray
    most: np.ndarray


def mixed_emitters(mesh: Mesh, shards: Sequence[ObservedShard]) -> Observations:
    """Find emitters that are seen in mixed pixels; return these pixels, sorted by view, with the emitter's radiance.

    Parameters
    ----------
    shards
        The training views.
    """
    islands = find_islands(mesh, [shard.samples for shard in shards])
    known = _island_samples(islands, shards)
    level = np.full((len(islands.number) + 1, 3), np.nan, np.float32)
    for name in np.unique(known.island):
        own = np.flatnonzero(known.island == name)
        most = float(np.average(known.most[own], weights=known.share[own]))
        mean = _emitted(known.radiance[own], known.error[own], known.tile[own], most)
        if mean is not None:
            level[name] = mean
    return _observed(shards, level[islands.number])


def _observed(shards: Sequence[ObservedShard], emitted: np.ndarray) -> Observations:
    """Pixels that show, with others, a triangle that is known to emit; ``emitted`` (T, 3) is NaN for all others."""
    columns: list[tuple[np.ndarray, ...]] = []
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own])
            use = np.isfinite(emitted[triangle, 0]) & (share >= _LEAST_SHARE) & (share < ALONE)
            rows = np.flatnonzero(use & (np.asarray(shard.weight[pixel]) > 0))
            columns.append((triangle[rows].astype(np.int64), np.full(len(rows), len(columns)), rows + own.start))
    triangle, view, sample = (np.concatenate(column) for column in zip(*columns, strict=True))
    nothing = np.zeros(len(triangle), np.float32)
    return Observations(triangle, emitted[triangle], view, nothing, nothing.astype(bool), sample)


def _island_samples(islands: Islands, shards: Sequence[ObservedShard]) -> _IslandSamples:
    """What tiles tell of islands, in all views."""
    parts = []
    tiles = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixels = samples.of_view(index), samples.pixels(index)
            usable = (np.asarray(shard.weight[pixels]) > 0) & ~np.asarray(shard.clipped[pixels])
            found = unmixed(samples, index, islands, np.asarray(shard.radiance[pixels]), usable)
            alone = np.flatnonzero(found.island >= 0)
            rows, tile = found.sample[alone] + own.start, found.tile[alone]
            parts.append(
                _IslandSamples(
                    found.island[alone],
                    found.radiance[alone],
                    found.error[alone],
                    tiles + tile,
                    np.asarray(samples.weight[rows]),
                    brightest_reflection(np.asarray(shard.shading[rows], np.float32)),
                )
            )
            tiles += int(tile.max(initial=-1)) + 1
    return _IslandSamples(
        *(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(_IslandSamples))
    )


def _emitted(radiance: np.ndarray, error: np.ndarray, tile: np.ndarray, most: float) -> np.ndarray | None:
    """(3,) mean radiance of an island, None where it may reflect.

    Parameters
    ----------
    radiance, error, tile
        (N, 3) and (N,), (N,) of its samples.
    most
        The brightest reflection.
    """
    _, first = np.unique(tile, return_index=True)
    if len(first) < _FEWEST:
        return None
    level, trust = radiance[first], 1 / np.maximum(error[first], 1e-6) ** 2
    mean = np.average(level, axis=0, weights=trust)
    spread = np.average(np.square(level - mean).mean(axis=1), weights=trust) ** 0.5
    doubt = max(spread * np.sqrt(np.square(trust).sum()) / trust.sum(), trust.sum() ** -0.5)
    return mean if mean.mean() - _SIGMAS * doubt > EMITTER_GAIN * most else None
