"""Points to shade: samples of a view as such points, their random numbers, and shading a chunk of them at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np

from fipt.scene.cameras import Camera
from fipt.scene.samples import FootprintSamples

CHUNK = 1 << 16
"""Points a kernel launch: enough to fill a CPU, few enough for progress to move."""


@dataclass(frozen=True)
class Points:
    """Points to shade.

    Attributes
    ----------
    position, normal, wo
        (N, 3) place (metres), unit normal, unit direction to the viewer.
    key
        (N,) uint64 key of their random numbers, see `random_keys`.
    """

    position: np.ndarray
    normal: np.ndarray
    wo: np.ndarray
    key: np.ndarray


def random_keys(view: str, pixel: np.ndarray, piece: np.ndarray, seed: int) -> np.ndarray:
    """(N,) uint64 keys that depend on view, pixel, piece (below 256) and seed only: results do not depend on shards."""
    base = int.from_bytes(blake2b(f"{seed}/{view}".encode(), digest_size=8).digest(), "little")
    x = (pixel.astype(np.uint64) * np.uint64(256) + piece.astype(np.uint64)) ^ np.uint64(base)
    with np.errstate(over="ignore"):  # splitmix64, modulo 2^64
        x = x + np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def view_points(samples: FootprintSamples, index: int, camera: Camera, seed: int) -> Points:
    """Footprint samples of view number ``index`` as points to shade."""
    own = samples.of_view(index)
    position = np.asarray(samples.position[own])
    wo = camera.center.astype(np.float32) - position
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    pixel = samples.pixel_of_sample(index)
    piece = np.arange(own.start, own.stop) - np.asarray(samples.offsets[samples.pixels(index)])[pixel]
    return Points(position, np.asarray(samples.normal[own]), wo, random_keys(camera.name, pixel, piece, seed))


def spread_points(
    samples: FootprintSamples, index: int, camera: Camera, normals: np.ndarray, per_sample: int, seed: int
) -> Points:
    """Points that are spread over the piece of each footprint sample of a view.

    A picture averages over a pixel, in which the border of a shadow, a mirrored edge or half of a thin leg may lie.

    Parameters
    ----------
    normals
        (T, 3) unit normals of the triangles, by winding order.
    per_sample
        Points of each sample; at most `SUB_POSITIONS`.

    Returns
    -------
    N * per_sample points of N samples; those of a sample follow one another and have one key.
    """
    middle, own = view_points(samples, index, camera, seed), samples.of_view(index)
    if per_sample == 1:
        return middle
    offset = np.asarray(samples.sub[own])[:, :per_sample].astype(np.float32)
    position = (middle.position[:, None] + offset).reshape(-1, 3)
    wo = camera.center.astype(np.float32) - position
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    normal = normals[np.asarray(samples.sub_triangle[own])[:, :per_sample].reshape(-1)]
    normal = np.where((normal * wo).sum(axis=1, keepdims=True) < 0, -normal, normal)
    rounding = np.linalg.norm(offset.reshape(-1, 3), axis=1, keepdims=True) * np.finfo(np.float16).eps / 2
    position += rounding * normal  # offsets are half floats: no point is rounded to behind its surface
    return Points(position, normal, wo, np.repeat(middle.key, per_sample))


def shade_in_chunks(
    points: Points,
    outputs: int,
    shade: Callable[[Points, slice], np.ndarray],
    advance: Callable[[int], None],
    paths: int,
    per_sample: int = 1,
) -> np.ndarray:
    """Call ``shade`` on chunks of points and gather its (samples, outputs, 3) results; ``paths`` each are reported.

    A sample is ``per_sample`` points that follow one another.
    """
    result = np.empty((len(points.position) // per_sample, outputs, 3), np.float32)
    size = CHUNK // per_sample
    for start in range(0, len(result), size):
        part, own = slice(start, start + size), slice(start * per_sample, (start + size) * per_sample)
        chunk = Points(points.position[own], points.normal[own], points.wo[own], points.key[own])
        result[part] = shade(chunk, part)
        advance(len(result[part]) * paths)
    return result
