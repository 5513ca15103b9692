"""The dataset's own segment ids, made worse view by view, as a network may give them."""

import zlib
from collections.abc import Iterator, Mapping

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from fipt.errors import FiptError
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples
from fipt.stages.segment.settings import DegradedSegments


class DegradedIds:
    """True ids of the views of a shard, degraded and numbered anew in each; their classes are not known.

    Raises
    ------
    FiptError
        If the dataset has no ids.
    """

    names: Mapping[int, str] = {}

    def __init__(self, data: Dataset, shard: FootprintSamples, settings: DegradedSegments) -> None:
        self._data, self._views, self._settings = data, shard.views, settings
        kind = data.segment_kind()
        if kind is None:
            raise FiptError(
                f"{data.root} has no segment ids, and segment.mode degraded makes worse ones of them",
                "choose another segment.mode",
            )
        self._kind = kind

    def views(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """The views, their ids (H, W) uint16 and the classes (K,) int32 of these: unknown."""
        settings = self._settings
        for view in self._views:
            rng = np.random.default_rng([settings.seed, zlib.crc32(view.encode())])
            ids = degraded(self._data.segments(view, self._kind), rng, settings.noise, settings.shift)
            ids = renumbered(ids, rng)
            yield view, ids, np.zeros(int(ids.max()) + 1, np.int32)


def degraded(ids: np.ndarray, rng: np.random.Generator, noise: float = 0.15, shift: float = 3.0) -> np.ndarray:
    """Ids (H, W) with edges moved by up to ``shift`` pixels and a share ``noise`` of pixels of random segments.

    The shift is smooth over about 10 pixels; along each axis it is spread evenly from -``shift`` to ``shift``.
    """
    field = gaussian_filter(rng.normal(size=(2, *ids.shape)), (0, 4, 4))
    field = shift * (2 * ndtr(field / field.std()) - 1)
    place = np.rint(np.mgrid[: ids.shape[0], : ids.shape[1]] + field).astype(int)
    moved = ids[np.clip(place[0], 0, ids.shape[0] - 1), np.clip(place[1], 0, ids.shape[1] - 1)]
    known = np.unique(ids[ids > 0])
    random = rng.choice(known, ids.shape) if len(known) else moved
    return np.where(rng.random(ids.shape) < noise, random, moved).astype(np.uint16)


def renumbered(ids: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Ids (H, W) from 1 in random order; 0 stays."""
    present = np.unique(ids[ids > 0])
    table = np.zeros(int(ids.max()) + 1, np.uint16)
    table[present] = rng.permutation(len(present)) + 1
    return table[ids]
