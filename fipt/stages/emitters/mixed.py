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
from fipt.scene.mixed import ALONE, islands, unmixed
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.observations import Observations

_LEAST_SHARE = 0.2
"""Share of a pixel below which it says little of a surface."""
_SIGMAS = 3.0
"""Standard errors by which an island must be brighter than reflections."""
_FEWEST = 3
"""Tiles whose scatter tells an error."""


@dataclass(frozen=True)
class _Told:
    """N samples of islands whose radiance a tile tells.

    ``island``, ``view``, ``tile``, ``sample``, ``triangle`` (N,) int64; ``radiance`` (N, 3); ``error``, ``share`` of
    the pixel and ``most``, the brightest reflection, (N,).
    """

    island: np.ndarray
    radiance: np.ndarray
    error: np.ndarray
    tile: np.ndarray
    view: np.ndarray
    sample: np.ndarray
    triangle: np.ndarray
    share: np.ndarray
    most: np.ndarray


def mixed_emitters(mesh: Mesh, shards: Sequence[ObservedShard]) -> Observations:
    """Find emitters that are seen in mixed pixels; return these pixels, sorted by view, with the emitter's radiance.

    Parameters
    ----------
    shards
        The training views.
    """
    told = _told(mesh, shards)
    radiance, tells = told.radiance.astype(np.float32), np.zeros(len(told.island), bool)
    for name in np.unique(told.island):
        own = np.flatnonzero(told.island == name)
        most = float(np.average(told.most[own], weights=told.share[own]))
        mean = _emitted(told.radiance[own], told.error[own], told.tile[own], most)
        if mean is not None:
            radiance[own] = mean
            tells[own] = (told.share[own] >= _LEAST_SHARE) & (told.share[own] < ALONE)
    nothing = np.zeros(int(tells.sum()), np.float32)
    return Observations(
        told.triangle[tells], radiance[tells], told.view[tells], nothing, nothing.astype(bool), told.sample[tells]
    )


def _told(mesh: Mesh, shards: Sequence[ObservedShard]) -> _Told:
    """What tiles tell of islands, in all views."""
    island = islands(mesh, [shard.samples for shard in shards])
    parts = []
    tiles = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixels = samples.of_view(index), samples.pixels(index)
            usable = (np.asarray(shard.weight[pixels]) > 0) & ~np.asarray(shard.clipped[pixels])
            found = unmixed(samples, index, island, np.asarray(shard.radiance[pixels]), usable)
            alone = np.flatnonzero(found.island >= 0)
            rows, tile = found.sample[alone] + own.start, found.tile[alone]
            parts.append(
                _Told(
                    found.island[alone],
                    found.radiance[alone],
                    found.error[alone],
                    tiles + tile,
                    np.full(len(rows), len(parts)),
                    rows,
                    np.asarray(samples.triangle[rows]).astype(np.int64),
                    np.asarray(samples.weight[rows]),
                    brightest_reflection(np.asarray(shard.shading[rows], np.float32)),
                )
            )
            tiles += int(tile.max(initial=-1)) + 1
    return _Told(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(_Told)))


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
