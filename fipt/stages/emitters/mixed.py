"""Emitters that hardly a pixel shows alone: a window behind blinds, tubes behind a grille.

Their radiance is told by pixels that show other surface as well (`fipt.scene.mixed`), tile by tile. An island emits if
the tiles of which it is the largest say together that it is brighter by `EMITTER_GAIN` than any reflection, three
standard errors aside. Its pixels are then observations as others are, with the radiance of the island alone.
"""

from collections.abc import Sequence

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


def mixed_emitters(mesh: Mesh, shards: Sequence[ObservedShard]) -> Observations:
    """Find emitters that are seen in mixed pixels; return these pixels, sorted by view, with the emitter's radiance.

    Parameters
    ----------
    shards
        The training views.
    """
    island = islands(mesh, [shard.samples for shard in shards])
    columns: list[tuple[np.ndarray, ...]] = []
    view = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixels = samples.of_view(index), samples.pixels(index)
            usable = (np.asarray(shard.weight[pixels]) > 0) & ~np.asarray(shard.clipped[pixels])
            found = unmixed(samples, index, island, np.asarray(shard.radiance[pixels]), usable)
            chief = np.flatnonzero(found.island >= 0)
            rows = found.sample[chief] + own.start
            most = brightest_reflection(np.asarray(shard.shading[rows], np.float32))
            share, triangle = np.asarray(samples.weight[rows]), np.asarray(samples.triangle[rows]).astype(np.int64)
            _, tile = np.unique(found.tile[chief], return_inverse=True)
            tile = tile.reshape(-1) + (columns[-1][3].max(initial=-1) + 1 if columns else 0)
            error, radiance = found.error[chief], found.radiance[chief]
            columns.append((found.island[chief], radiance, error, tile, most, share, triangle, np.full(len(rows), view), rows))  # fmt: skip
            view += 1
    number, radiance, error, tile, most, share, triangle, views, rows = (
        np.concatenate(column) for column in zip(*columns, strict=True)
    )
    tells = np.zeros(len(number), bool)
    for name in np.unique(number):
        own = np.flatnonzero(number == name)
        mean = _emitted(radiance[own], error[own], tile[own], np.average(most[own], weights=share[own]))
        if mean is None:
            continue
        radiance[own] = mean
        tells[own] = (share[own] >= _LEAST_SHARE) & (share[own] < ALONE)
    nothing = np.zeros(int(tells.sum()), np.float32)
    return Observations(
        triangle[tells], radiance[tells].astype(np.float32), views[tells], nothing, nothing.astype(bool), rows[tells]
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
