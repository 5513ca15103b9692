"""The emitters for people: a list with names and images, and the file in which a person decides about them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.formats.images import to_display
from fipt.progress import progress
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import default_name
from fipt.scene.review import ReviewDecisions, matched, numbers
from fipt.scene.samples import ALONE, FootprintSamples

_AROUND = 1.0
"""Of the emitter's size: what its image shows on each side of it."""
_LEAST = 0.25
"""Of the view's width: an image shows at least so much, for the emitter to be recognised by what surrounds it."""
_GREY = 0.25
"""Displayed level of the median of what surrounds the emitter, linear."""
_LINE = np.array([255, 0, 200], np.uint8)
_LISTED = re.compile(r"emitters\.json|(emitter|lamp|rejected|undecided)-\d+\.png")
"""Names of the files of a list, also of one that an older version wrote."""


@dataclass(frozen=True)
class Visibility:
    """Where an emitter is seen: the views that show it alone in a pixel, and the view that shows most of it.

    Masked pixels show nothing.
    """

    views: list[str]
    best: tuple[int, int] | None
    """Shard, and number of the view in it; None where no pixel shows any of it."""


def strange_files(out: Path) -> list[str]:
    """Names of the files in a folder that no list of emitters has."""
    return [path.name for path in sorted(out.glob("[!.]*")) if not _LISTED.fullmatch(path.name)]


def emitter_names(decided: ReviewDecisions, emitters: Sequence[np.ndarray], triangles: int) -> list[str]:
    """Name of every emitter: what a person gave to most of its triangles, else its number."""
    given = [numbers(text, triangles) for text in decided.names.values()]
    names = list(map(default_name, range(len(emitters))))
    for number, emitter in matched(given, emitters).items():
        names[emitter] = list(decided.names)[number]
    return names


def review_entry(row: dict[str, Any], triangles: np.ndarray, image: str | None) -> dict[str, Any]:
    """Facts of an emitter for the file of decisions, rounded for eyes."""
    facts = {"area": row["area"], "power": sum(row["power"]) / 3, "share": row["share"]}
    facts = {key: float(f"{value:.4g}") for key, value in (facts | {"confidence": row["confidence"]}).items()}
    rest = {"emitter": default_name(row["index"]), "question": None, "views": row["views"], "thumbnail": image}
    rest["guessed"] = row["guessed"]
    return rest | facts | {"triangles": frozenset(triangles.tolist())}


def review_question(row: dict[str, Any], triangles: np.ndarray, image: str | None) -> dict[str, Any]:
    """Facts of a surface that may emit for the file of decisions."""
    unknown = dict.fromkeys(("emitter", "power", "share", "confidence", "views"))
    facts = {"question": row["question"], "area": float(f"{row['area']:.4g}"), "thumbnail": image}
    return unknown | facts | {"triangles": frozenset(triangles.tolist())}


# --- images -------------------------------------------------------------------------------------


def visibilities(
    data: Dataset, shards: Sequence[FootprintSamples], emitters: Sequence[np.ndarray], triangles: int
) -> list[Visibility]:
    """Where each emitter (its triangles) is seen."""
    number = np.full(triangles, len(emitters), np.int32)
    for emitter, own in enumerate(emitters):
        number[own] = emitter
    views: list[list[str]] = [[] for _ in emitters]
    best: list[tuple[int, int] | None] = [None for _ in emitters]
    most = np.zeros(len(emitters))
    with progress("review", sum(len(shard.views) for shard in shards), " views") as bar:
        for which, shard in enumerate(shards):
            for index, view in enumerate(shard.views):
                samples = shard.of_view(index)
                emitter, weight = number[np.asarray(shard.triangle[samples])], np.asarray(shard.weight[samples])
                if (emitter < len(emitters)).any():
                    weight = weight * (data.image(view)[1].ravel()[shard.pixel_of_sample(index)] > 0)
                alone = np.bincount(emitter[weight >= ALONE], minlength=len(emitters) + 1)[:-1]
                for k in np.flatnonzero(alone):
                    views[k].append(view)
                seen = np.bincount(emitter, weight, len(emitters) + 1)[:-1]
                for k in np.flatnonzero(seen > most):
                    best[k] = (which, index)
                most = np.maximum(most, seen)
                bar.advance()
    return [Visibility(*found) for found in zip(views, best, strict=True)]


def thumbnail(
    data: Dataset, shards: Sequence[FootprintSamples], seen: Visibility, triangles: np.ndarray, width: int
) -> np.ndarray | None:
    """(3/4 width, width, 3) uint8 image of an emitter in the view that shows most of it; None where none does."""
    if seen.best is None:
        return None
    shard, index = shards[seen.best[0]], seen.best[1]
    samples, (height, columns) = shard.of_view(index), shard.shapes[index]
    covered = np.bincount(
        shard.pixel_of_sample(index),
        np.asarray(shard.weight[samples]) * np.isin(shard.triangle[samples], triangles),
        height * columns,
    ).reshape(height, columns)
    mask = covered >= min(0.5, covered.max())
    rows, cols = _crop(mask)
    return _drawn(data.image(shard.views[index])[0][rows, cols], mask[rows, cols], (width, width * 3 // 4))


def _crop(mask: np.ndarray) -> tuple[slice, slice]:
    """Part of a view, of 4 : 3 where it is large enough, around the pixels (H, W) of an emitter."""
    height, width = mask.shape
    y, x = np.nonzero(mask)
    tall, wide = y.max() - y.min() + 1, x.max() - x.min() + 1
    across = max((1 + 2 * _AROUND) * max(wide, tall * 4 / 3), _LEAST * width)
    size = np.minimum(np.ceil([across * 3 / 4, across]).astype(int), [height, width])
    middle = np.array([y.min() + y.max() + 1, x.min() + x.max() + 1]) // 2
    first = np.clip(middle - size // 2, 0, np.array([height, width]) - size)
    return slice(first[0], first[0] + size[0]), slice(first[1], first[1] + size[1])


def _drawn(radiance: np.ndarray, mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Image (h, w, 3) uint8 of at most a size, tone mapped so that emitter and surroundings show, the emitter outlined.

    Highlights are compressed (Reinhard), the brightest is white.
    """
    from PIL import Image
    from scipy.ndimage import binary_dilation, binary_erosion

    level = radiance.mean(axis=-1)
    around = level[~mask & (level > 0)]
    exposed = radiance * (_GREY / max(float(np.median(around)) if len(around) else float(level.max()), 1e-9))
    white = max(float(exposed.max()), 1.0)
    toned = to_display(exposed * (1 + exposed / white**2) / (1 + exposed))
    scale = min(size[0] / mask.shape[1], size[1] / mask.shape[0])
    shape = max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale))
    image = np.array(Image.fromarray(toned).resize(shape, Image.Resampling.BICUBIC))
    emitter = np.array(Image.fromarray(np.uint8(255) * mask).resize(shape, Image.Resampling.BILINEAR)) > 127
    image[binary_dilation(emitter, iterations=3) & ~binary_erosion(emitter)] = 0
    image[binary_dilation(emitter, iterations=2) & ~emitter] = _LINE
    return image
