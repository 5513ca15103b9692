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


def shade_in_chunks(
    points: Points,
    outputs: int,
    shade: Callable[[Points, slice], np.ndarray],
    advance: Callable[[int], None],
    paths: int,
) -> np.ndarray:
    """Call ``shade`` on chunks of points and gather its (n, outputs, 3) results; ``paths`` a point are reported."""
    result = np.empty((len(points.position), outputs, 3), np.float32)
    for start in range(0, len(result), CHUNK):
        part = slice(start, start + CHUNK)
        chunk = Points(points.position[part], points.normal[part], points.wo[part], points.key[part])
        result[part] = shade(chunk, part)
        advance(len(chunk.position) * paths)
    return result
