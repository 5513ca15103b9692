"""What the photographs show of a shard's footprint samples, with the shading that was baked there."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.scene.dataset import Dataset
from fipt.scene.samples import Empty, FootprintSamples, clipped_of, pixels_of, read_samples
from fipt.scene.shading import Shading, read_shading


@dataclass(frozen=True)
class ObservedShard:
    """Footprint samples of some views: H samples in P pixels.

    Attributes
    ----------
    samples
        What surface each pixel shows.
    shading
        (H, outputs, 3) baked shading.
    radiance
        (P, 3) float32 observed radiance of the pixels.
    weight
        (P,) float32 weight of the pixels, 0 where they are not valid.
    clipped
        (P,) bool: the radiance is only a lower bound.
    """

    samples: FootprintSamples
    shading: Shading | np.ndarray
    radiance: np.ndarray
    weight: np.ndarray
    clipped: np.ndarray


def read_observed(
    dataset: Dataset, samples: Sequence[Path | str], shading: Sequence[Path | str], empty: Empty = np.empty
) -> list[ObservedShard]:
    """Read shards, given as folders of samples and of their shading in the same order.

    ``empty`` makes the arrays over all pixels: in memory, or `fipt.formats.arrays.on_disk`.

    Raises
    ------
    FiptError
        If the folders do not belong together, or a file is missing or damaged.
    """
    if len(samples) != len(shading):
        raise FiptError(
            f"--samples and --shading must name as many shards; {len(samples)} and {len(shading)} given",
            "give the same shards in the same order",
        )
    shards = []
    for folder, baked in zip(samples, shading, strict=True):
        shard = read_samples(folder)
        own = read_shading(baked, shard)
        shards.append(ObservedShard(shard, own, *pixels_of(dataset, shard, empty), clipped_of(dataset, shard, empty)))
    return shards
