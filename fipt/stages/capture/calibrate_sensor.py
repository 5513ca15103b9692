"""Black levels, bad pixels, noise and vignetting, from dark frames and flat fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.robust import deviation, spread
from fipt.scene.blocks import blocks
from fipt.stages.capture.calibration import Calibration, Noise, Vignetting
from fipt.stages.capture.calibration_frames import counted, read_frame, signal_of
from fipt.stages.capture.mosaic import tiled
from fipt.stages.capture.raw import RawFrame

_BLOCKS = 30
"""Blocks along the shorter side of a flat field, whose means the vignetting curve is fitted to."""

_TERMS = 4
"""Coefficients of the vignetting polynomial: up to r^8."""

_UNEVEN = 0.03
"""Root mean square by which blocks of a flat field may differ from a smooth falloff: lit by hand, and out of focus, one
differs by less than 0.01."""

_DARKEST_CORNER = 0.05
"""Share of the centre's light that the corners of any lens have, at least: cos^4 of 60 degrees."""

_CLIPPED = 0.98
"""Share of the range above which a calibration frame counts as clipped."""


def with_dark(found: Calibration, paths: Sequence[Path], bar: Any) -> Calibration:
    """Black levels and hot pixels from the mean of the dark frames."""
    if not paths:
        return found
    total, noises = np.zeros((found.height, found.width), np.float32), []
    for path in paths:
        frame = read_frame(path, found)
        values = frame.mosaic.astype(np.float32)
        total += values
        noises.append(spread(values[::2, ::2].ravel()))
        bar.advance()
    mean, read = total / len(paths), max(float(np.median(noises)), 12**-0.5)
    black = np.zeros(4)
    hot = np.zeros(mean.shape, bool)
    for (i, j), color in np.ndenumerate(frame.pattern):
        part = mean[i::2, j::2]
        middle = np.median(part)
        hot[i::2, j::2] = part > middle + max(12 * read, 0.002 * frame.range[color])
        black[color] = part[~hot[i::2, j::2]].mean()
        darker = frame.range[color] * 0.25
        if black[color] - frame.black[color] > darker:
            raise FiptError(
                f"{paths[0]} must be dark; its mean is {black[color] - frame.black[color]:.0f} above the file's "
                f"black level {frame.black[color]:g}",
                "photograph it with the lens cap on",
            )
    # Differences of neighbours of one colour have twice the variance; the mean of frames has 1/n of it.
    steps = mean[:, 2:] - mean[:, :-2]
    calm = steps[np.abs(steps) < 6 * read * np.sqrt(2 / len(paths)) + 0.5]
    read = float(np.std(calm) / np.sqrt(2 / len(paths)))
    return replace(
        found,
        black=tuple(black.tolist()),
        bad_pixels=tuple(map(tuple, np.argwhere(hot).tolist())),
        sources={**found.sources, "black": counted(paths, "dark"), "bad_pixels": counted(paths, "dark")},
        figures={**found.figures, "read_noise": read, "hot_pixels": int(hot.sum())},
    )


def with_flats(found: Calibration, paths: Sequence[Path], bar: Any) -> Calibration:
    """Vignetting from images of an even surface; the sensor's noise where dark frames are there too."""
    if not paths:
        return found
    blocks, gains, total = [], [], np.zeros((found.height, found.width), np.float32)
    for path in paths:
        frame = read_frame(path, found)
        signal = signal_of(frame, found)
        means = _block_means(signal, frame.pattern)
        _check_flat(path, frame, signal, means, found)
        blocks.append(means / np.median(means, axis=(0, 1)))
        gains.append(_photon_gain(signal, found.figures.get("read_noise", 0.0)))
        total += signal
        bar.advance()
    dead = _dead_pixels(total)
    mean = np.mean(blocks, axis=0).mean(axis=2)
    vignetting, profile, spread = fit_vignetting(mean, found.width, found.height)
    if not _DARKEST_CORNER <= _corner(vignetting, found) <= 1.05:
        raise FiptError(
            f"flat fields must fall off to {_DARKEST_CORNER:.0%} to 105% in the corners; {paths[0].parent} gives "
            f"{_corner(vignetting, found):.0%}",
            "photograph an evenly lit surface, out of focus, that fills the frame",
        )
    noise = found.noise
    if "read_noise" in found.figures and frame.shot.iso:
        noise = Noise(float(np.median(gains)), found.figures["read_noise"], frame.shot.iso)
    curve = {"curve": profile, "spread": spread, "aperture": frame.shot.aperture, "corner": _corner(vignetting, found)}
    sources = {**found.sources, "vignetting": counted(paths, "flat field")}
    if noise is not None:
        sources["noise"] = "dark frames and flat fields"
    return replace(
        found,
        vignetting=vignetting,
        noise=noise,
        bad_pixels=tuple(sorted({*found.bad_pixels, *dead})),
        sources=sources,
        figures={**found.figures, "vignetting": curve, "dead_pixels": len(dead)},
    )


def _dead_pixels(light: np.ndarray) -> list[tuple[int, int]]:
    """(row, column) of pixels that see less than 70 % of what those of their colour around them see."""
    dead = np.zeros(light.shape, bool)
    for i, j in np.ndindex(2, 2):
        part = np.ascontiguousarray(light[i::2, j::2])
        dead[i::2, j::2] = part < 0.7 * cv2.medianBlur(part, 5)
    return [(int(row), int(column)) for row, column in np.argwhere(dead)]


def fit_vignetting(means: np.ndarray, width: int, height: int) -> tuple[Vignetting, list[list[float]], float]:
    """Fit an even polynomial about a fitted centre to means of blocks of pixels.

    Parameters
    ----------
    means
        (rows, columns) mean light of blocks of pixels, from the top left, as large as `_block` says.
    width, height
        Of the image, pixels.

    Returns
    -------
    vignetting
        The polynomial, 1 in its centre.
    profile
        [radius, measured light] for a plot: medians of rings, radius 1 = half the diagonal.
    spread
        Root mean square of the relative residuals.
    """
    from scipy.optimize import least_squares

    radius, block = np.hypot(width, height) / 2, _block((height, width))
    y, x = np.meshgrid(*(block * (np.arange(n) + 0.5) for n in means.shape), indexing="ij")
    light = means / means.max()

    def solved(center: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        r2 = ((x - center[0]) ** 2 + (y - center[1]) ** 2) / radius**2
        powers = r2.ravel()[:, None] ** np.arange(_TERMS + 1)
        factors, *_ = np.linalg.lstsq(powers, light.ravel(), rcond=None)
        return factors, light.ravel() - powers @ factors, r2

    middle = np.array([width / 2, height / 2])
    reach = 0.1 * np.array([width, height])
    best = least_squares(lambda c: solved(c)[1], middle, bounds=(middle - reach, middle + reach), x_scale=reach)
    factors, residual, r2 = solved(best.x)
    coefficients = tuple((factors[1:] / factors[0]).tolist())
    vignetting = Vignetting((float(best.x[0]), float(best.x[1])), float(radius), coefficients)
    ring = np.minimum((np.sqrt(r2) * 24).astype(int), 24).ravel()
    measured = light.ravel() / factors[0]
    profile = [
        [round((r + 0.5) / 24, 4), round(float(np.median(measured[ring == r])), 5)] for r in np.unique(ring).tolist()
    ]
    return vignetting, profile, float(np.sqrt(np.mean((residual / light.ravel()) ** 2)))


def _check_flat(path: Path, frame: RawFrame, signal: np.ndarray, means: np.ndarray, found: Calibration) -> None:
    full = tiled(frame.range, frame.pattern, *frame.shape)
    clipped = float((signal > _CLIPPED * full).mean())
    if clipped > 0.001:
        raise FiptError(
            f"{path} must be an even surface below the sensor's limit; {clipped:.1%} of its pixels are clipped",
            "photograph the flat field shorter",
        )
    light = means.mean(axis=2)
    rows, columns = (_block(frame.shape) * (np.arange(n) + 0.5) for n in light.shape)
    r = np.hypot(rows[:, None] - found.height / 2, columns - found.width / 2) / np.hypot(found.width, found.height) * 2
    ratio = float(light[r > 0.75].mean() / light[r < 0.25].mean())
    if ratio > 1.005:
        raise FiptError(
            f"{path} must be brightest near its centre; its corners are {ratio:.2f} times brighter",
            "photograph an evenly lit surface, out of focus, without a shadow of the camera",
        )
    uneven = fit_vignetting(light, found.width, found.height)[2]
    if uneven > _UNEVEN:
        raise FiptError(
            f"{path} must be an even surface; it differs by {uneven:.1%} from any falloff about a centre",
            "photograph an evenly lit surface without a pattern, out of focus; boards have folders of their own",
        )


def _block_means(signal: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """(rows, columns, 4) means by colour index of blocks of pixels (`_block`)."""
    block = _block(signal.shape)
    rows, columns = (n // block for n in signal.shape)
    means = np.empty((rows, columns, 4))
    half = block // 2
    for (i, j), color in np.ndenumerate(pattern):
        means[..., color] = blocks(signal[i::2, j::2], half)[:rows, :, :columns].mean(axis=(1, 3))
    return means


def _block(shape: tuple[int, int]) -> int:
    """Side of the blocks in pixels: even, so that they hold whole cells of the mosaic."""
    return max(2, min(shape) // _BLOCKS // 2 * 2)


def _photon_gain(signal: np.ndarray, read: float) -> float:
    """Variance of an even surface over its light, from neighbours of one colour."""
    middle = signal[:, 2:-2]
    bend = signal[:, :-4] - 2 * middle + signal[:, 4:]  # blind to slopes; its variance is 6 times a pixel's
    light = np.maximum((signal[:, :-4] + middle + signal[:, 4:]) / 3, 1.0)
    noise = deviation(bend / np.sqrt(light))
    return float(max(noise**2 / 6 - read**2 * np.mean(1 / light), 1e-6))


def _corner(vignetting: Vignetting, found: Calibration) -> float:
    x, y = np.array([[0, found.width, 0, found.width], [0, 0, found.height, found.height]], np.float32)
    return float(vignetting.falloff(x, y).mean())
