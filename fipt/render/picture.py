"""Pictures of the model: shading of first hits by path tracing, combined with their materials."""

from collections.abc import Callable

import numpy as np

from fipt.io.cameras import Camera
from fipt.io.hits import Hits
from fipt.render.layers import denoise_hits
from fipt.render.points import shade_in_chunks, view_points
from fipt.render.tracer import Shader


def radiance_of_hits(
    shader: Shader,
    hits: Hits,
    index: int,
    camera: Camera,
    base_color: np.ndarray,
    roughness: np.ndarray,
    metallic: np.ndarray,
    spp: int,
    denoised: bool,
    seed: int,
    advance: Callable[[int], None],
) -> np.ndarray:
    """Reflected radiance (N, 3) of the N hits of a view: kd Ld + ks Ls0(s) + Ls1(s) at each hit's own roughness.

    Parameters
    ----------
    base_color, roughness, metallic
        (N, 3), (N,), (N,) of the hits.
    denoised
        Denoise the three integrals before they meet the materials, so that texture stays sharp.
    """
    points = view_points(hits, index, camera, seed)
    counts = [spp - spp // 2, spp // 2]
    shading = shade_in_chunks(
        points, 3, lambda chunk, part: shader.shade(chunk, [roughness[part]], counts), advance, spp
    )
    if denoised:
        shading = denoise_hits(shading, hits, index)
    m = metallic[:, None]
    kd, ks = base_color * (1 - m), 0.04 * (1 - m) + base_color * m
    return kd * shading[:, 0] + ks * shading[:, 1] + shading[:, 2]


def pixels_of_hits(values: np.ndarray, hits: Hits, index: int, background: np.ndarray) -> np.ndarray:
    """(H, W, 3) picture from radiance (N, 3) of a view's hits; the share that no hit covers shows ``background``,
    (3,) or (H * W, 3).
    """
    height, width = hits.shapes[index]
    pixel, weight = (
        hits.pixel_of_hit(index),
        np.asarray(hits.weight[hits.of_view(index)], np.float64),
    )
    covered = np.bincount(pixel, weight, height * width)
    sums = [np.bincount(pixel, weight * values[:, c], height * width) for c in range(3)]
    picture = np.stack(sums, axis=1) + np.maximum(1 - covered, 0)[:, None] * background
    return picture.reshape(height, width, 3).astype(np.float32)
