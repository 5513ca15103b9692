"""Points to shade, a chunk at a time; samples of a view as such points."""

from collections.abc import Callable

import numpy as np

from fipt.render.tracer import Points, random_keys
from fipt.scene.cameras import Camera
from fipt.scene.samples import FootprintSamples

CHUNK = 1 << 16
"""Hits a kernel launch: enough to fill a CPU, few enough for progress to move."""


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
