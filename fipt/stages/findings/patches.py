"""Small patches of training views around edges: photograph and fit at full resolution."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.model.fitted import FittedScene
from fipt.scene.blocks import blocks
from fipt.scene.observed import ObservedShard
from fipt.stages.findings.explained import pixels_of_view

SIDE = 14
"""Of a patch, pixels."""


@dataclass(frozen=True)
class EdgePatches:
    """P patches.

    Attributes
    ----------
    view
        Name of the view of each.
    corner
        (P, 2) int64 row and column of the first pixel.
    photo, predicted
        (P, SIDE, SIDE, 3) radiance.
    """

    view: tuple[str, ...]
    corner: np.ndarray
    photo: np.ndarray
    predicted: np.ndarray


def edge_patches(shards: Sequence[ObservedShard], fitted: FittedScene, most: int) -> EdgePatches:
    """Return about ``most`` patches, the same number of every view: those whose photograph has the strongest edges.

    Patches with pixels that are not valid, clipped, off the mesh or show an emitter are left out.
    """
    total = sum(len(shard.samples.views) for shard in shards)
    found: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]] = []
    for shard in shards:
        for index, view in enumerate(shard.samples.views):
            corners = _corners(shard, index, max(most // max(total, 1), 1))
            if not len(corners):
                continue
            rows = (corners[:, :1, None] + np.arange(SIDE)[:, None] + np.zeros(SIDE, int)).reshape(-1)
            columns = (corners[:, 1:, None] + np.arange(SIDE) + np.zeros((SIDE, 1), int)).reshape(-1)
            own = pixels_of_view(shard, index, (rows, columns), fitted, queries=1)
            if len(own["row"]) < len(rows):  # a pixel sees no surface: its patch is spoiled, and the order with it
                continue
            shape = (len(corners), SIDE, SIDE)
            whole = (own["use"] & ~own["emits"]).reshape(shape).all(axis=(1, 2))
            photo, predicted = (own[name].reshape(*shape, 3) for name in ("photo", "predicted"))
            found += [(view, corners[k], photo[k], predicted[k]) for k in np.flatnonzero(whole)]
    empty = np.zeros((0, SIDE, SIDE, 3), np.float32)
    return EdgePatches(
        tuple(view for view, *_ in found),
        np.array([corner for _, corner, *_ in found]).reshape(-1, 2),
        np.array([photo for *_, photo, _ in found]) if found else empty,
        np.array([predicted for *_, predicted in found]) if found else empty,
    )


def _corners(shard: ObservedShard, index: int, most: int) -> np.ndarray:
    """(N, 2) rows and columns of patches of a view on a grid, strongest edges first, all of them on the mesh."""
    samples, pixels = shard.samples, shard.samples.pixels(index)
    height, width = samples.shapes[index]
    down, across = height // SIDE, width // SIDE
    if not down or not across:
        return np.zeros((0, 2), np.int64)
    level = np.asarray(shard.radiance[pixels]).mean(axis=1).reshape(height, width)
    seen = (np.diff(samples.offsets[pixels.start : pixels.stop + 1]) > 0).reshape(height, width)
    gradient = np.hypot(*np.gradient(np.log(level + 0.05 * float(np.median(level)) + 1e-9)))

    strength = np.where(blocks(seen, SIDE).all(axis=(1, 3)), blocks(gradient**2, SIDE).sum(axis=(1, 3)), 0)
    order = np.argsort(-strength, axis=None, kind="stable")[:most]
    order = order[strength.reshape(-1)[order] > 0]
    return np.stack(np.divmod(order, across), axis=1) * SIDE
