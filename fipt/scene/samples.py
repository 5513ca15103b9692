"""Footprint samples on disk: flat arrays over surface pieces, and each pixel's offset into them."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from fipt.conventions import SUB_POSITIONS
from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, save_npy
from fipt.formats.files import existing_file, write_text
from fipt.formats.manifests import ListedFiles
from fipt.formats.origins import check_origin, origin
from fipt.formats.text import MALFORMED
from fipt.scene.dataset import Dataset

Empty = Callable[..., np.ndarray]
"""Makes an array of a shape and dtype, like ``np.empty``."""
_GOLDEN = (5**0.5 - 1) / 2
ALONE = 0.9
"""Share of its pixel that a sample must cover to show its surface's own radiance."""


@dataclass(frozen=True)
class FootprintSamples:
    """Footprint samples of some views: each is one piece of surface inside one pixel.

    The pixels of all views are concatenated, row-major within a view: P pixels hold H samples.

    Attributes
    ----------
    views
        Names of the views.
    shapes
        (height, width) of every view.
    offsets
        (P + 1,) int64; pixel p owns samples ``offsets[p]`` to ``offsets[p + 1]``.
    center
        (P,) uint8; 1 where the ray through the pixel's centre meets the mesh: its first sample is then that piece.
    position, normal
        (H, 3) float32; a point of the piece (metres), the geometric unit normal turned to the viewer.
    triangle
        (H,) int32 index into the mesh.
    footprint
        (H,) float32 width of the pixel at the hit, across the ray, metres.
    weight
        (H,) float32 share of the pixel that the piece covers.
    sub
        (H, SUB_POSITIONS, 3) float16 offsets (metres) from position to points of the piece spread over the pixel.
    sub_triangle
        (H, SUB_POSITIONS) int32 triangles of these points.
    """

    views: tuple[str, ...]
    shapes: tuple[tuple[int, int], ...]
    offsets: np.ndarray
    center: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    triangle: np.ndarray
    footprint: np.ndarray
    weight: np.ndarray
    sub: np.ndarray
    sub_triangle: np.ndarray

    @property
    def first_pixels(self) -> np.ndarray:
        """(V + 1,) int64 first pixel of every view, and P."""
        return np.concatenate([[0], np.cumsum([h * w for h, w in self.shapes])]).astype(np.int64)

    def pixels(self, index: int) -> slice:
        """Pixels of view number ``index``."""
        first = self.first_pixels
        return slice(int(first[index]), int(first[index + 1]))

    def of_view(self, index: int) -> slice:
        """Samples of view number ``index``."""
        pixels = self.pixels(index)
        return slice(int(self.offsets[pixels.start]), int(self.offsets[pixels.stop]))

    def pixel_of_sample(self, index: int) -> np.ndarray:
        """(samples of the view,) int64: pixel number within view ``index`` of each of its samples."""
        pixels = self.pixels(index)
        counts = np.diff(self.offsets[pixels.start : pixels.stop + 1])
        return np.repeat(np.arange(len(counts)), counts)

    def samples_of(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The samples of some pixels (N,): (K,) int64 row of ``pixels`` and number of each sample, pixel by pixel."""
        first = np.asarray(self.offsets[pixels])
        count = np.asarray(self.offsets[pixels + 1]) - first
        row = np.repeat(np.arange(len(pixels)), count)
        return row, (first - np.cumsum(count) + count)[row] + np.arange(len(row))


_ARRAYS = ("offsets", "center", "position", "normal", "triangle", "footprint", "weight", "sub", "sub_triangle")


def write_samples(folder: str | Path, samples: FootprintSamples) -> list[Path]:
    """Write a shard's arrays into an existing folder; return the files."""
    folder = Path(folder)
    views = [{"name": n, "height": h, "width": w} for n, (h, w) in zip(samples.views, samples.shapes, strict=True)]
    write_text(folder / "views.json", json.dumps({"views": views, "origin": origin()}) + "\n")
    for name in _ARRAYS:
        save_npy(folder / f"{name}.npy", getattr(samples, name))
    return [folder / "views.json", *(folder / f"{name}.npy" for name in _ARRAYS)]


def read_samples(folder: str | Path) -> FootprintSamples:
    """Read a shard, arrays memory-mapped.

    Raises
    ------
    FiptError
        If a file is missing or the arrays do not belong together.
    """
    folder = Path(folder)
    listed = ListedFiles(folder)
    file = listed.check(existing_file(folder / "views.json", "the views of a samples shard"))
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
        views, made_of = about["views"], about.get("origin")
        names = tuple(view["name"] for view in views)
        shapes = tuple((int(view["height"]), int(view["width"])) for view in views)
    except MALFORMED as error:
        raise FiptError(f"{folder}/views.json is damaged ({error!r})", "run the samples stage again") from error
    check_origin(file, made_of)
    arrays = {name: load_npy(listed.check(folder / f"{name}.npy")) for name in _ARRAYS}
    samples = FootprintSamples(names, shapes, **arrays)
    count = len(samples.position)
    if (
        len(samples.offsets) != samples.first_pixels[-1] + 1
        or samples.offsets[0] != 0
        or samples.offsets[-1] != count
        or (np.diff(samples.offsets) < 0).any()
        or any(arrays[name].dtype.kind not in "iu" for name in ("offsets", "triangle", "sub_triangle"))
        or len(samples.center) != samples.first_pixels[-1]
        or samples.sub.shape != (count, SUB_POSITIONS, 3)
        or samples.sub_triangle.shape != (count, SUB_POSITIONS)
        or any(len(getattr(samples, name)) != count for name in ("normal", "triangle", "footprint", "weight"))
    ):
        raise FiptError(
            f"the arrays of {folder} do not belong together",
            "delete it and run the samples stage again",
        )
    return samples


def scene_box(shards: list[FootprintSamples]) -> tuple[np.ndarray, float]:
    """Cube around the seen samples: (3,) float64 centre and side in metres (longest extent x 1.05).

    All of them, but for what a few pixels see far outside: grids over the box would spend their voxels on a ground that
    a doorway shows. Where the nearest `_ROOM` of what is seen fits into a box half as large, its box is taken; points
    outside count as the nearest point of it.
    """
    positions = [shard.position for shard in shards if len(shard.position)]
    if not positions:
        raise FiptError("no camera ray hits the mesh", "check the poses, axes and units of the source")
    middle, reach = _reach(shards)
    whole, room = _bounds(positions, middle, np.inf), _bounds(positions, middle, reach)
    low, high = room if np.ptp(room, axis=0).max() < np.ptp(whole, axis=0).max() / 2 else whole
    return (low + high) / 2, float(max((high - low).max() * 1.05, 1e-6))


_ROOM = 0.99
"""Share of what is seen that is the room. One octave of a grid's resolution is worth a hundredth of the pixels: the
light that a voxel mixes errs by about its size over the distance of shadows and corners, ten times that and more.
"""
_COUNTED = 1 << 18
"""Samples that tell how far the room reaches; more change a quantile by less than a thousandth."""


def _reach(shards: list[FootprintSamples]) -> tuple[np.ndarray, float]:
    """(3,) median of the samples, and the largest difference of a coordinate within which `_ROOM` of them lie."""
    lengths = [len(shard.position) for shard in shards]
    rows = strided(lengths, max(1, -(-sum(lengths) // _COUNTED)))
    position = np.concatenate([shard.position[own] for shard, own in zip(shards, rows, strict=True)])
    weight = np.concatenate([shard.weight[own] for shard, own in zip(shards, rows, strict=True)]).astype(np.float64)
    middle = np.median(position, axis=0)
    distance = np.abs(position - middle).max(axis=1)
    order = np.argsort(distance)
    covered = np.cumsum(weight[order])
    last = np.searchsorted(covered, _ROOM * covered[-1])
    return middle, float(distance[order[min(int(last), len(order) - 1)]])


def _bounds(positions: list[np.ndarray], middle: np.ndarray, reach: float) -> np.ndarray:
    """(2, 3) float64 lowest and highest coordinates of the points that differ from ``middle`` by at most ``reach``."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for points in positions:
        near = points if reach == np.inf else points[np.abs(points - middle).max(axis=1) <= reach]
        if len(near):
            low, high = np.minimum(low, near.min(axis=0)), np.maximum(high, near.max(axis=0))
    return np.stack([low, high]).astype(np.float64)


def median_footprint(shards: Sequence[FootprintSamples]) -> float:
    """Width of a pixel on the surface, metres: the median of the samples, however they are sharded; 0 without any."""
    lengths = [len(shard.footprint) for shard in shards]
    if not any(lengths):
        return 0.0  # no view sees the mesh, which others say
    rows = strided(lengths, max(1, -(-sum(lengths) // _COUNTED)))
    return float(np.median(np.concatenate([shard.footprint[own] for shard, own in zip(shards, rows, strict=True)])))


def strided(lengths: Iterable[int], step: int) -> list[slice]:
    """Every ``step``-th of what follows one another in arrays of these lengths, however it is spread over them."""
    found, passed = [], 0
    for length in lengths:
        found.append(slice(-passed % step, None, step))
        passed += length
    return found


def scattered(first: int, count: int, step: int) -> np.ndarray:
    """(K,) int64 numbers below ``count``: one of each run of ``step``, counted from ``first`` before them.

    Each is at another place of its run (golden ratio): every ``step``-th pixel would lie in the same few columns of all
    views where ``step`` and the width of the images have a common divisor.
    """
    run = np.arange(first // step, -(-(first + count) // step))
    number = run * step + (run * _GOLDEN % 1 * step).astype(np.int64) - first
    return number[(number >= 0) & (number < count)]


def summed_by(groups: Iterable[tuple[np.ndarray, np.ndarray]], count: int) -> np.ndarray:
    """(count,) float64 sums of values (N,) by their numbers (N,), given array by array.

    Each is added by itself, so that the sums do not depend on how the values are spread over arrays.
    """
    total = np.zeros(count)
    for number, values in groups:
        np.add.at(total, number, np.asarray(values, np.float64))
    return total


def view_pixels(
    dataset: Dataset, shards: list[FootprintSamples]
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Pixels of every view of every shard, one view at a time.

    Yields
    ------
    Radiance (P, 3) and weight (P,) float32, and (P,) bool: the radiance is only a lower bound.
    """
    for shard in shards:
        for view in shard.views:
            image, weight = dataset.image(view)
            yield image.reshape(-1, 3), weight.reshape(-1), dataset.clipped(view).reshape(-1)


def pixels_of(dataset: Dataset, samples: FootprintSamples, empty: Empty = np.empty) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (P, 3) and weight (P,) float32 of all pixels of a shard, in its pixel order.

    ``empty`` makes the arrays: in memory, or `fipt.formats.arrays.on_disk`.
    """
    count = int(samples.first_pixels[-1])
    radiance, weight = empty((count, 3), np.float32), empty((count,), np.float32)
    for index, view in enumerate(samples.views):
        image, valid = dataset.image(view)
        radiance[samples.pixels(index)], weight[samples.pixels(index)] = image.reshape(-1, 3), valid.reshape(-1)
    return radiance, weight


def segments_of(dataset: Dataset, samples: FootprintSamples, kind: str, empty: Empty = np.empty) -> np.ndarray:
    """(P,) uint16 segment of all pixels of a shard, in its pixel order; ``empty`` as of `pixels_of`."""
    ids = empty((int(samples.first_pixels[-1]),), np.uint16)
    for index, view in enumerate(samples.views):
        ids[samples.pixels(index)] = dataset.segments(view, kind).reshape(-1)
    return ids


def segments_of_triangles(shards: Sequence[FootprintSamples], segments: Sequence[np.ndarray]) -> tuple[int, np.ndarray]:
    """Largest segment id, and the id of each triangle (T,) uint16, 0 where none is known.

    It is the id that most pixel centres give the triangle. One that only shows beside centres, as those of a thin leg
    do, has the id of the surface nearest to it that the centres around show, no further than the pixel is wide.

    Parameters
    ----------
    segments
        Per shard: (P,) segment of each pixel's centre, 0 = unknown.
    """
    count = max(int(shard.triangle.max(initial=0)) for shard in shards) + 1
    shown, votes = np.zeros(count, bool), _Votes()
    for shard, segment in zip(shards, segments, strict=True):
        for index in range(len(shard.views)):
            own = shard.pixels(index)
            centered = np.flatnonzero(np.asarray(shard.center[own]) > 0)
            triangle = np.asarray(shard.triangle[shard.offsets[own][centered]])
            shown[triangle] = True
            votes.add(triangle, segment[own][centered])
    beside = _Votes()
    for shard, segment in zip(shards, segments, strict=True):
        for index in range(len(shard.views)):
            beside.add(*_beside_centers(shard, index, segment[shard.pixels(index)], shown))
    return votes.largest, np.where(shown, votes.winners(count), beside.winners(count))


class _Votes:
    """Ids that pixels give triangles."""

    def __init__(self) -> None:
        self._pairs, self._votes = np.zeros(0, np.int64), np.zeros(0, np.int64)

    def add(self, triangle: np.ndarray, ids: np.ndarray) -> None:
        """Count triangles (N,) with ids (N,); 0 is none."""
        new, count = np.unique(triangle[ids > 0].astype(np.int64) << 16 | ids[ids > 0], return_counts=True)
        self._pairs, place = np.unique(np.concatenate([self._pairs, new]), return_inverse=True)
        summed = np.bincount(place.reshape(-1), np.concatenate([self._votes, count]), len(self._pairs))
        self._votes = summed.astype(np.int64)

    @property
    def largest(self) -> int:
        """Largest id that any pixel gives."""
        return int((self._pairs & 0xFFFF).max(initial=0))

    def winners(self, count: int) -> np.ndarray:
        """(count,) uint16 id with the most votes of each triangle, 0 where there are none."""
        triangle, ids = self._pairs >> 16, self._pairs & 0xFFFF
        order = np.lexsort((self._votes, triangle))
        winner = np.zeros(count, np.uint16)
        winner[triangle[order]] = ids[order]  # the last write, with the most votes, stays
        return winner


def _beside_centers(
    samples: FootprintSamples, index: int, segment: np.ndarray, shown: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (N,) of a view that are not ``shown`` (T,), and the ids (N,) of what is nearest around them, or 0.

    ``segment`` (pixels of the view,) is of pixel centres; those of the pixel itself and of the eight around it count.
    """
    height, width = samples.shapes[index]
    own = samples.of_view(index)
    at = np.flatnonzero(~shown[np.asarray(samples.triangle[own])])
    row, column = np.divmod(samples.pixel_of_sample(index)[at], width)
    at += own.start
    place = np.asarray(samples.position[at])
    nearest = np.array(samples.footprint[at], np.float32)  # as far as the pixel is wide
    ids = np.zeros(len(at), segment.dtype)
    first = samples.pixels(index).start
    for down, right in product((-1, 0, 1), repeat=2):
        inside = np.flatnonzero(
            (row + down >= 0) & (row + down < height) & (column + right >= 0) & (column + right < width)
        )
        pixel = (row[inside] + down) * width + column[inside] + right
        has = np.asarray(samples.center[first + pixel]) > 0
        inside, pixel = inside[has], pixel[has]
        center = np.asarray(samples.position[np.asarray(samples.offsets[first + pixel])])
        distance = np.linalg.norm(center - place[inside], axis=1)
        nearer = distance < nearest[inside]
        ids[inside[nearer]], nearest[inside[nearer]] = segment[pixel[nearer]], distance[nearer]
    return np.asarray(samples.triangle[at]), ids


def clipped_of(dataset: Dataset, samples: FootprintSamples, empty: Empty = np.empty) -> np.ndarray:
    """(P,) bool of all pixels of a shard: the radiance is only a lower bound; order and ``empty`` as of `pixels_of`."""
    clipped = empty((int(samples.first_pixels[-1]),), bool)
    for index, view in enumerate(samples.views):
        clipped[samples.pixels(index)] = dataset.clipped(view).reshape(-1)
    return clipped
