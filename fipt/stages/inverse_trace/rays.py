"""Training pixels, and rays through them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.render.replay import PathBatch
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples, clipped_of, pixels_of


@dataclass(frozen=True)
class TrainingPixels:
    """P pixels with weight of all views.

    Attributes
    ----------
    data
        Whose cameras take them.
    views
        Names of the views.
    view, row, column
        (P,) int32.
    radiance
        (P, 3) float32.
    clipped
        (P,) bool: the radiance is only a lower bound.
    """

    data: Dataset
    views: Sequence[str]
    view: np.ndarray
    row: np.ndarray
    column: np.ndarray
    radiance: np.ndarray
    clipped: np.ndarray

    def rays(self, chosen: np.ndarray, spp: int, rng: np.random.Generator) -> PathBatch:
        """``spp`` rays through random places of each of some pixels (N,), one after another: N * spp rays."""
        pixel = np.repeat(chosen, spp)
        place = rng.random((2, len(pixel)))
        origin, direction = np.empty((2, len(pixel), 3), np.float32)
        for index in np.unique(self.view[pixel]):
            own = self.view[pixel] == index
            camera = self.data.camera(self.views[int(index)])
            origin[own] = camera.center
            columns, rows = self.column[pixel[own]] + place[0, own], self.row[pixel[own]] + place[1, own]
            direction[own] = camera.directions(columns, rows)
        return PathBatch(origin, direction)


def training_pixels(data: Dataset, shards: Sequence[FootprintSamples]) -> TrainingPixels:
    """Every pixel with weight whose centre shows the mesh."""
    views = [view for shard in shards for view in shard.views]
    found, first = [], 0
    for shard in shards:
        radiance, weight = pixels_of(data, shard)
        clipped = clipped_of(data, shard)
        for index, (_, width) in enumerate(shard.shapes):
            span = shard.pixels(index)
            use = np.flatnonzero((weight[span] > 0) & (np.asarray(shard.center[span]) > 0))
            row, column = np.divmod(use, width)
            own = np.full(len(use), first + index)
            found.append((own, row, column, radiance[span][use], clipped[span][use]))
        first += len(shard.views)
    view, row, column, radiance, clipped = (np.concatenate(each) for each in zip(*found, strict=True))
    return TrainingPixels(data, views, view, row, column, radiance, clipped)
