"""Footprint samples of a view's camera rays, gathered into one or a few pieces of surface per pixel.

An image averages over a pixel while a model is asked at points. Each pixel is therefore sampled by several rays; those
that meet the same smooth piece of one object become one sample with a weight. So a pixel inside a surface costs one
sample, and a pixel on an edge as many as it shows surfaces.
"""

from math import gcd
from typing import Protocol

import numpy as np

from fipt.conventions import SUB_POSITIONS
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.samples import FootprintSamples

_SAME_NORMAL = 0.85
"""Cosine above which two sub-pixel samples can lie on one piece."""
_QUARTERS = np.array([(1, 3), (3, 7), (7, 5), (5, 1)]) / 8
"""Where `SUB_POSITIONS` points should lie to stand for a pixel: their mean is its centre, and no two lie in one row or
column of quarters. Opposite ones stand two apart: who asks at two points takes every second one."""
_SAME_PLANE = 0.35
"""Distance from the piece's plane, in footprints, up to which a sub-pixel hit belongs to it."""
_FAR = float(np.finfo(np.float16).max)
"""Metres: half a float holds no more."""


class Sampling(Protocol):
    """How finely pixels are sampled."""

    @property
    def grid(self) -> int:
        """A pixel is sampled by the square of this many rays."""
        ...

    @property
    def max_samples(self) -> int:
        """Footprint samples kept of a pixel."""
        ...


def sub_pixel_points(count: int) -> np.ndarray:
    """(count, 2) points in [0, 1)^2 that spread evenly: the pixel's centre, then those of a lattice.

    Seen from any side no two of a lattice's points lie in line, and their mean is the pixel's centre: a sequence such
    as R2 looks a tenth of a pixel beside it on average, which moves the whole picture. (Of 4 or 9 points the mean is
    0.03 pixels beside it, since one makes way for the centre.) After the centre come four that stand for all; then each
    point is the one farthest from those before it.
    """
    k = np.arange(count)
    lattices = [np.stack([k, k * step % count], axis=1) for step in range(1, count + 1) if gcd(step, count) == 1]
    points = (max(lattices, key=_gap) + 0.5) / count
    points[np.argmin(((points - 0.5) ** 2).sum(axis=1))] = 0.5
    order = [int(np.argmin(((points - 0.5) ** 2).sum(axis=1)))]
    if count > SUB_POSITIONS:
        away = ((points - _QUARTERS[:, None]) ** 2).sum(axis=2)
        away[:, order] = np.inf
        order += away.argmin(axis=1).tolist()
    near = np.min([((points - points[one]) ** 2).sum(axis=1) for one in order], axis=0)
    while len(order) < count:
        order.append(int(near.argmax()))
        near = np.minimum(near, ((points - points[order[-1]]) ** 2).sum(axis=1))
    return points[order]


def _gap(lattice: np.ndarray) -> int:
    """Squared least distance between points (N, 2) of a lattice that repeats every N."""
    away = lattice[1:] - lattice[0]
    return int((np.minimum(away, len(lattice) - away) ** 2).sum(axis=1).min(initial=len(lattice) ** 2))


def trace_view(scene: RayScene, parts: np.ndarray, camera: Camera, sampling: Sampling) -> dict[str, np.ndarray]:
    """Trace the rays of one view and gather them into samples.

    Parameters
    ----------
    parts
        (T,) int32 connected component of every triangle.

    Returns
    -------
    dict
        ``counts`` (pixels,) samples per pixel, and the arrays of `FootprintSamples` for this view.
    """
    pixels = camera.width * camera.height
    offsets = sub_pixel_points(sampling.grid**2)
    samples = len(offsets)
    rows, columns = np.divmod(np.arange(pixels), camera.width)
    directions = camera.directions(
        (columns[:, None] + offsets[None, :, 0]).ravel(),
        (rows[:, None] + offsets[None, :, 1]).ravel(),
    )
    distance, triangle = scene.intersect(camera.center, directions)
    found = (triangle >= 0).reshape(pixels, samples)
    distance = np.where(np.isfinite(distance), distance, 0.0)
    points = (camera.center + distance[:, None] * directions).astype(np.float32).reshape(pixels, samples, 3)
    normals = scene.normals[triangle]
    normals = np.where((normals * directions).sum(1, keepdims=True) > 0, -normals, normals)
    normals = normals.reshape(pixels, samples, 3)
    triangle = triangle.reshape(pixels, samples)
    part = np.where(found, parts[triangle], -1)
    footprint = distance.reshape(pixels, samples) / camera.fx

    piece = _pieces(found, part, points, normals, footprint, sampling.max_samples)
    return _gather(piece, found, points, normals, triangle, footprint)


def _pieces(
    found: np.ndarray,
    part: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    footprint: np.ndarray,
    most: int,
) -> np.ndarray:
    """(pixels, samples) int: number of the piece that each sub-pixel hit belongs to, -1 for misses."""
    piece = np.full(found.shape, -1)
    todo = np.arange(len(found))
    for number in range(most):
        free = found[todo] & (piece[todo] < 0)
        todo = todo[free.any(axis=1)]
        if len(todo) == 0:
            break
        free = found[todo] & (piece[todo] < 0)
        first = free.argmax(axis=1)
        row = np.arange(len(todo))
        p0, n0 = points[todo, first], normals[todo, first]
        height = np.abs(np.einsum("psk,pk->ps", points[todo] - p0[:, None], n0))
        same = (
            (part[todo] == part[todo, first][:, None])
            & (np.einsum("psk,pk->ps", normals[todo], n0) > _SAME_NORMAL)
            & (height < _SAME_PLANE * footprint[todo])
        )
        same[row, first] = True
        if number == most - 1:
            same |= True  # no more pieces are kept: what is left joins the last one
        piece[todo] = np.where(free & same, number, piece[todo])
    return piece


def _gather(
    piece: np.ndarray,
    found: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    triangle: np.ndarray,
    footprint: np.ndarray,
) -> dict[str, np.ndarray]:
    """Flatten (pixels, samples) arrays into samples, pixel by pixel, piece by piece."""
    pixels, samples = piece.shape
    pixel, sample = np.nonzero(found)
    order = np.lexsort((sample, piece[pixel, sample], pixel))
    pixel, sample = pixel[order], sample[order]
    number = piece[pixel, sample]
    new = np.ones(len(pixel), bool)
    new[1:] = (pixel[1:] != pixel[:-1]) | (number[1:] != number[:-1])
    start = np.flatnonzero(new)
    size = np.diff(np.append(start, len(pixel)))

    # the member closest to the piece's mean stands for it; the pixel's centre ray where it is a member
    flat = points[pixel, sample]
    owner = np.repeat(np.arange(len(start)), size)
    mean = np.add.reduceat(flat, start, axis=0) / size[:, None] if len(start) else flat[:0]
    away = np.where(sample == 0, -1.0, ((flat - mean[owner]) ** 2).sum(axis=1))
    chosen = np.lexsort((away, owner))[start] if len(start) else start
    position = flat[chosen]
    # after the centre, the first few members are spread over the piece; small pieces repeat theirs
    skipped = ((size > SUB_POSITIONS) & (sample[start] == 0)).astype(int)[:, None]
    picks = start[:, None] + skipped + np.arange(SUB_POSITIONS) % (size[:, None] - skipped)
    return {
        "counts": np.bincount(pixel[start], minlength=pixels),
        "center": found[:, 0].astype(np.uint8),
        "position": position.astype(np.float32),
        "normal": normals[pixel[chosen], sample[chosen]].astype(np.float32),
        "triangle": triangle[pixel[chosen], sample[chosen]].astype(np.int32),
        "footprint": footprint[pixel[chosen], sample[chosen]].astype(np.float32),
        "weight": (size / samples).astype(np.float32),
        "sub": np.clip(flat[picks] - position[:, None], -_FAR, _FAR).astype(np.float16),
        "sub_triangle": triangle[pixel, sample][picks].astype(np.int32),
    }


def joined(cameras: list[Camera], results: list[dict[str, np.ndarray]]) -> FootprintSamples:
    """Put the results of `trace_view` of several views together, or of none: all of a shard may be rejected."""
    rays, vectors = np.zeros((0, 1)), np.zeros((0, 1, 3))
    results = [_gather(rays.astype(int), rays > 0, vectors, vectors, rays, rays), *results]
    counts = np.concatenate([result["counts"] for result in results])
    names = [name for name in results[0] if name != "counts"]
    return FootprintSamples(
        views=tuple(camera.name for camera in cameras),
        shapes=tuple((camera.height, camera.width) for camera in cameras),
        offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        **{name: np.concatenate([result[name] for result in results]) for name in names},
    )
