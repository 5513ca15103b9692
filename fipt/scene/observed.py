"""What the photographs show of a shard's footprint samples, with the shading that was baked there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from fipt.conventions import SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.scene.change import read_round
from fipt.scene.dataset import Dataset
from fipt.scene.environment import covered_share
from fipt.scene.samples import Empty, FootprintSamples, clipped_of, pixels_of, read_samples
from fipt.scene.shading import Shading

_SLIVER = 1e-3
"""Share of a pixel that shows nothing and is rounding."""


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


_FULL = 0.99
"""Share of the usual weight from which on a pixel counts in full: less is the rim of a mask."""


def fully_weighted(weight: np.ndarray) -> np.ndarray:
    """(...) bool: pixels of a view with the usual weight (...) of those that count: the rims of masks have less."""
    some = weight[weight > 0]
    return weight > _FULL * (float(np.median(some)) if some.size else 1.0)


def full_pixels(samples: FootprintSamples, weight: np.ndarray) -> np.ndarray:
    """(P,) bool: the same of all pixels of a shard, each view by itself: which views are together means nothing."""
    views = [weight[samples.pixels(index)] for index in range(len(samples.views))]
    return np.concatenate([fully_weighted(np.asarray(own)) for own in views])


def read_observed(
    dataset: Dataset, samples: Sequence[Path | str], shading: Sequence[Path | str], empty: Empty = np.empty
) -> list[ObservedShard]:
    """Read all shards of the training views, given as folders of samples and of their shading in the same order.

    ``empty`` makes the arrays over all pixels and samples: in memory, or `fipt.formats.arrays.on_disk`.

    Raises
    ------
    FiptError
        If the folders do not belong together, or a file is missing or damaged.
    """
    check_as_many("--shading", shading, samples)
    own = [read_samples(folder) for folder in samples]
    return [
        ObservedShard(shard, light, *pixels_of(dataset, shard, empty), clipped_of(dataset, shard, empty))
        for shard, light in zip(own, read_round(shading, own, empty), strict=True)
    ]


def check_as_many(option: str, folders: Sequence[Path | str], samples: Sequence[Path | str]) -> None:
    """Refuse folders of shards that an option names, if they are not as many as those of ``--samples``."""
    if len(samples) != len(folders):
        raise FiptError(
            f"--samples and {option} must name as many shards; {len(samples)} and {len(folders)} given",
            "give the same shards in the same order",
        )


def before_shading(dataset: Dataset, samples: Sequence[FootprintSamples]) -> list[ObservedShard]:
    """The same of shards of which nothing is baked yet: their shading has no rows."""
    nothing = np.zeros((0, SHADING_OUTPUTS, 3), np.float32)
    return [ObservedShard(shard, nothing, *pixels_of(dataset, shard), clipped_of(dataset, shard)) for shard in samples]


def without_openings(shards: Sequence[ObservedShard]) -> list[ObservedShard]:
    """The same shards; no weight is left to pixels that show any outside, and to the eight around each."""
    return [
        _without(shard, lambda index, of=shard: covered_share(of.samples, index) < 1 - _SLIVER, around=True)
        for shard in shards
    ]


def without_triangles(
    shards: Sequence[ObservedShard], triangles: np.ndarray, around: bool = False
) -> list[ObservedShard]:
    """The same shards; no weight is left to pixels that show one of these triangles, if only in part.

    Nor to the eight ``around`` each, if asked for.
    """
    if len(triangles) == 0:
        return list(shards)
    named = np.zeros(int(triangles.max()) + 1, bool)
    named[triangles] = True
    result = []
    for shard in shards:
        samples = shard.samples

        def shows(index: int, samples: FootprintSamples = samples) -> np.ndarray:
            triangle = np.asarray(samples.triangle[samples.of_view(index)])
            own = named[np.minimum(triangle, len(named) - 1)] & (triangle < len(named))
            shown = np.zeros(int(np.prod(samples.shapes[index])), bool)
            shown[samples.pixel_of_sample(index)[own]] = True
            return shown

        result.append(_without(shard, shows, around))
    return result


def _without(shard: ObservedShard, shows: Callable[[int], np.ndarray], around: bool) -> ObservedShard:
    """The shard without weight where ``shows`` of a view's number, (pixels of the view,) bool, is true, or beside.

    Where mesh and lens are not exact, a pixel shows some of what is beside it; nor do its rays find what fills less of
    it than one of them. What is as bright as an emitter or the sky changes such a pixel all the same.
    """
    weight = np.array(shard.weight)
    for index, shape in enumerate(shard.samples.shapes):
        shown = shows(index)
        if around:
            shown = binary_dilation(shown.reshape(shape), np.ones((3, 3), bool)).ravel()
        weight[shard.samples.pixels(index)][shown] = 0
    return replace(shard, weight=weight)


def filled_by_one(
    samples: FootprintSamples,
    shading: Shading | np.ndarray,
    pixel: np.ndarray,
    segment_of: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Those of some pixels whose samples are all of one segment.

    Radiance is linear in shading, and one segment has one material: the samples of such a pixel count as one with the
    weighted mean of their shading.

    Parameters
    ----------
    shading
        (H, outputs, 3) of the samples.
    pixel
        (N,) int64 pixels that have samples.
    segment_of
        Segments (K,) of samples, by their pixels (K,) and numbers (K,).

    Returns
    -------
    pixel, first, segment
        (M,) int64 pixel, its first sample, the segment.
    shading
        (M, outputs, 3) float32 mean over its samples.
    """
    first = np.asarray(samples.offsets[pixel])
    count = np.asarray(samples.offsets[pixel + 1]) - first
    if len(pixel) == 0:
        return pixel, first, first, np.zeros((0, SHADING_OUTPUTS, 3), np.float32)
    starts = np.cumsum(count) - count
    row, sample = samples.samples_of(pixel)
    segment = segment_of(pixel[row], sample)
    one = np.minimum.reduceat(segment, starts) == np.maximum.reduceat(segment, starts)
    keep, segment = np.repeat(one, count), segment[starts[one]]
    pixel, first, count, sample = pixel[one], first[one], count[one], sample[keep]
    if len(pixel) == 0:
        return pixel, first, first, np.zeros((0, SHADING_OUTPUTS, 3), np.float32)
    starts = np.cumsum(count) - count
    weight = np.asarray(samples.weight[sample], np.float32)
    weight /= np.repeat(np.add.reduceat(weight, starts), count)
    each = np.asarray(shading[sample], np.float32).reshape(-1, SHADING_OUTPUTS, 3)
    return pixel, first, segment, np.add.reduceat(each * weight[:, None, None], starts, axis=0)
