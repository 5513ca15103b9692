"""Slanted PatchMatch: every pixel takes the best plane among its own, its neighbours' and changed ones.

A plane is an inverse depth and its slopes along u and v, so that the window of a pixel is carried into a source exactly
as the plane would be seen there (Bleyer et al. 2011; Galliani et al. 2015). One Dr.Jit kernel tries all candidates of
all pixels at once; it is the same for the CPU and for CUDA.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from fipt.stages.geometry.stereo_view import StereoView, transfer
from fipt.stages.geometry.sweep import BEST, LEAST, UNSEEN

REACH, _STRIDE = 4, 2
"""Half side of the window, and distance of the pixels in it that are looked at, pixels."""
_ALIKE = 0.3
"""Log radiance that differs by this much belongs to another surface half: such pixels count less in a window."""
_SEEN = 0.5
"""Share of a window's weight that a source must show."""
_GRAZING = 0.1
"""Cosine between surface and view, at least."""
_NEIGHBOURS = np.array(
    [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (3, 0), (-3, 0), (0, 3), (0, -3), (7, 5), (-5, 7), (-7, -5), (5, -7)]
)
"""Columns and rows to the pixels whose planes are tried; the first is the pixel itself."""
_CHANGES = 4
"""Changed planes that are tried in a round."""


@dataclass(frozen=True)
class _Matching:
    """What the kernel reads, as Dr.Jit arrays."""

    dj: ModuleType
    columns: int
    rows: int
    light: Any
    texels: Any
    """Per source pixel the four values of the square right of and below it."""
    tables: Any
    """Per source A, b, its columns and rows."""
    begins: Any
    """Per source where its texels begin: float32 holds no odd number beyond 2^24."""
    count: int
    camera: Any
    noise: float


_TABLE = 14


def refine(
    dj: ModuleType,
    reference: StereoView,
    sources: Sequence[StereoView],
    planes: np.ndarray,
    rounds: int,
    nearest: float,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Improve planes.

    Parameters
    ----------
    dj
        Dr.Jit's module of the device in use, such as ``drjit.llvm``.
    planes
        (3, H, W) float32 to start from: inverse depth and slopes.
    rounds
        How often neighbours are asked; what is changed shrinks from one to the next.
    nearest
        Least distance of a surface, metres.

    Returns
    -------
    planes
        (3, H, W) float32.
    score
        (H, W) float32 in [-1, 1].
    """
    matching = _matching(dj, reference, sources)
    rng = np.random.default_rng(seed)
    shape = reference.light.shape
    state = [dj.Float(part.ravel()) for part in planes]
    score = None
    for step in range(rounds):
        # the first changes reach over half a window's worth of parallax, the last ones over what can be measured
        scale = 0.5**step
        random = rng.uniform(-1, 1, (_CHANGES * 3, shape[0] * shape[1])).astype(np.float32)
        random *= np.repeat(0.5 ** np.arange(_CHANGES), 3)[:, None].astype(np.float32) * scale
        *state, score = _round(matching, state, dj.Float(random.ravel()), 1 / nearest)
    result = np.stack([np.array(part).reshape(shape) for part in state])
    return result, np.array(score).reshape(shape)


def _matching(dj: ModuleType, reference: StereoView, sources: Sequence[StereoView]) -> _Matching:
    texels, tables = [], []
    for source in sources:
        light = np.pad(source.light, ((0, 1), (0, 1)), mode="edge")
        texels.append(np.stack([light[:-1, :-1], light[:-1, 1:], light[1:, :-1], light[1:, 1:]], -1).reshape(-1, 4))
        turn, shift = transfer(reference, source)
        rows, columns = source.light.shape
        tables.append([*turn.ravel(), *shift, columns, rows])
    begins = np.cumsum([0, *(source.light.size for source in sources[:-1])], dtype=np.int32)
    matrix = reference.intrinsics
    rows, columns = reference.light.shape
    return _Matching(
        dj, columns, rows, dj.Float(reference.light.ravel()),
        dj.Float(np.concatenate(texels).ravel()), dj.Float(np.array(tables, np.float32).ravel()), dj.Int32(begins),
        len(sources),
        [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]],
        max(reference.noise, *(source.noise for source in sources)) ** 2 + 1e-8,
    )  # fmt: skip


def _round(matching: _Matching, state: list[Any], random: Any, most: float) -> list[Any]:
    """Try all candidates of all pixels: new inverse depth, slopes and score."""
    import drjit as dr

    dj = matching.dj
    columns, rows = dr.opaque(dj.Int32, matching.columns), dr.opaque(dj.Int32, matching.rows)
    lane = dr.arange(dj.Int32, matching.columns * matching.rows)
    y, x = lane // columns, lane % columns
    offsets = dj.Int32(_NEIGHBOURS.astype(np.int32).ravel())
    window = _window(matching, x, y, columns, rows)
    camera = [dr.opaque(dj.Float, float(value)) for value in matching.camera]
    ray_x, ray_y = (dj.Float(x) - camera[2]) / camera[0], (dj.Float(y) - camera[3]) / camera[1]
    noise, most_q = dr.opaque(dj.Float, matching.noise), dr.opaque(dj.Float, most)
    q, along_u, along_v = state

    def attempt(k: Any, best_q: Any, best_u: Any, best_v: Any, best: Any) -> tuple[Any, ...]:
        near = k < len(_NEIGHBOURS)
        entry = 2 * dr.minimum(k, len(_NEIGHBOURS) - 1)
        du = dr.gather(dj.Int32, offsets, entry)
        dv = dr.gather(dj.Int32, offsets, entry + 1)
        nx, ny = dr.clip(x + du, 0, columns - 1), dr.clip(y + dv, 0, rows - 1)
        other = ny * columns + nx
        other_u, other_v = dr.gather(dj.Float, along_u, other), dr.gather(dj.Float, along_v, other)
        other_q = dr.gather(dj.Float, q, other) - other_u * dj.Float(nx - x) - other_v * dj.Float(ny - y)
        # the pixel's best plane, moved and tilted: by shares of its inverse depth, of a slope of 45 degrees
        r = [
            dr.gather(dj.Float, random, (3 * dr.maximum(k - len(_NEIGHBOURS), 0) + i) * (columns * rows) + lane)
            for i in range(3)
        ]
        moved = best_q * (1 + 0.1 * r[0])
        tilted_u = best_u + r[1] * best_q / camera[0]
        tilted_v = best_v + r[2] * best_q / camera[1]
        new_q = dr.select(near, other_q, moved)
        new_u = dr.select(near, other_u, tilted_u)
        new_v = dr.select(near, other_v, tilted_v)
        normal = dj.Array3f(new_u * camera[0], new_v * camera[1], 0)
        normal.z = new_q - normal.x * ray_x - normal.y * ray_y
        ray = dr.sqrt(1 + ray_x * ray_x + ray_y * ray_y)
        allowed = (new_q > 0) & (new_q < most_q) & (new_q > _GRAZING * dr.norm(normal) * ray)
        score = _score(matching, window, x, y, (new_q, new_u, new_v), noise)
        better = allowed & (score > best)
        return (
            k + 1,
            dr.select(better, new_q, best_q),
            dr.select(better, new_u, best_u),
            dr.select(better, new_v, best_v),
            dr.select(better, score, best),
        )

    last = len(_NEIGHBOURS) + _CHANGES
    start = (dj.Int32(0), dj.Float(q), dj.Float(along_u), dj.Float(along_v), dr.full(dj.Float, -2, dr.width(lane)))
    _, *result = dr.while_loop(start, lambda k, *_: k < last, attempt, label="PatchMatch")
    dr.eval(result)
    return result


def _window(matching: _Matching, x: Any, y: Any, columns: Any, rows: Any) -> list[tuple[int, int, Any, Any]]:
    """Columns and rows to the pixels of the window, log radiance there less that of the centre, and weight."""
    import drjit as dr

    dj = matching.dj
    centre = dr.gather(dj.Float, matching.light, y * columns + x)
    taps = []
    for dv in range(-REACH, REACH + 1, _STRIDE):
        for du in range(-REACH, REACH + 1, _STRIDE):
            tx, ty = x + du, y + dv
            inside = (tx >= 0) & (ty >= 0) & (tx < columns) & (ty < rows)
            value = dr.gather(dj.Float, matching.light, dr.select(inside, ty * columns + tx, 0)) - centre
            known = inside & (value == value)
            fall = -(du * du + dv * dv) / (2.0 * REACH * REACH)
            weight = dr.exp(fall - dr.abs(value) / _ALIKE)
            taps.append((du, dv, dr.select(known, value, 0), dr.select(known, weight, 0)))
    return taps


def _score(matching: _Matching, window: list[Any], x: Any, y: Any, plane: tuple[Any, Any, Any], noise: Any) -> Any:
    """Mean correlation of a plane's windows with the best sources that show them; -1 where too few do."""
    import drjit as dr

    dj = matching.dj
    q, along_u, along_v = plane
    u, v = dj.Float(x), dj.Float(y)

    def compare_source(s: Any, *held: Any) -> tuple[Any, ...]:
        t = [dr.gather(dj.Float, matching.tables, _TABLE * s + i) for i in range(_TABLE)]
        at = [t[3 * i] * u + t[3 * i + 1] * v + t[3 * i + 2] + t[9 + i] * q for i in range(3)]
        by_u = [t[3 * i] + t[9 + i] * along_u for i in range(3)]
        by_v = [t[3 * i + 1] + t[9 + i] * along_v for i in range(3)]
        frame = [*t[12:], dr.gather(dj.Int32, matching.begins, s)]
        value = _correlation(matching, window, (at, by_u, by_v), frame, noise)
        result = []
        for best in held:
            result.append(dr.maximum(best, value))
            value = dr.minimum(best, value)
        return (s + 1, *result)

    start = (dj.Int32(0), *(dr.full(dj.Float, UNSEEN, dr.width(x)) for _ in range(BEST)))
    _, *held = dr.while_loop(start, lambda s, *_: s < matching.count, compare_source, label="sources")
    count: Any = sum(dr.select(best > UNSEEN, 1.0, 0.0) for best in held)
    total = sum(dr.select(best > UNSEEN, best, 0.0) for best in held)
    return dr.select(count >= LEAST, total / dr.maximum(count, 1), -1.0)


def _correlation(
    matching: _Matching, window: list[Any], map_: tuple[Any, Any, Any], frame: list[Any], noise: Any
) -> Any:
    """Weighted correlation of a window with a source; `UNSEEN` where that shows too little of it."""
    import drjit as dr

    dj = matching.dj
    at, by_u, by_v = map_
    columns, rows, begin = frame
    total = dj.Float(0)
    seen, sum_a, sum_b, sum_aa, sum_bb, sum_ab = (dj.Float(0) for _ in range(6))
    offset = None
    for du, dv, a, weight in window:
        px, py, pz = (at[i] + du * by_u[i] + dv * by_v[i] for i in range(3))
        ahead = pz > 1e-3
        scale = dr.rcp(dr.select(ahead, pz, 1))
        px, py = px * scale, py * scale
        inside = ahead & (px >= 0) & (py >= 0) & (px <= columns - 1) & (py <= rows - 1)
        cx, cy = dr.floor(dr.select(inside, px, 0)), dr.floor(dr.select(inside, py, 0))
        fx, fy = px - cx, py - cy
        place = begin + dj.Int32(cy) * dj.Int32(columns) + dj.Int32(cx)
        square = dr.gather(dj.Array4f, matching.texels, place, inside)
        upper, lower = dr.lerp(square[0], square[1], fx), dr.lerp(square[2], square[3], fx)
        b = dr.lerp(upper, lower, fy)
        known = inside & (b == b)
        if offset is None:
            offset = dr.select(known, b, 0)
        b = dr.select(known, b - offset, 0)
        w = dr.select(known, weight, 0)
        total += weight
        seen += w
        sum_a, sum_b = dr.fma(w, a, sum_a), dr.fma(w, b, sum_b)
        sum_aa, sum_bb, sum_ab = dr.fma(w * a, a, sum_aa), dr.fma(w * b, b, sum_bb), dr.fma(w * a, b, sum_ab)
    scale = dr.rcp(dr.maximum(seen, 1e-6))
    mean_a, mean_b = sum_a * scale, sum_b * scale
    variance_a = dr.maximum(sum_aa * scale - mean_a * mean_a, 0) + noise
    variance_b = dr.maximum(sum_bb * scale - mean_b * mean_b, 0) + noise
    value = (sum_ab * scale - mean_a * mean_b) * dr.rsqrt(variance_a * variance_b)
    return dr.select((seen > _SEEN * total) & (total > 0), value, UNSEEN)
