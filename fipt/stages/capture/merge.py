"""Brackets of raw mosaics to one linear image, with masks of what is wrong in it.

Signals are raw values above black over the sensor's range, exposures are in seconds at ISO 100 and f/8, so that
radiance = signal / exposure is in sensor ranges per second. Frames come longest exposure first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from fipt.stages.capture.calibration import Noise, Vignetting
from fipt.stages.capture.mosaic import demosaic, tiled
from fipt.stages.capture.raw import RawFrame

_STRIP = 8
"""Rows worked on at once: arrays of a strip stay in the processor's cache."""

_MOVED = 3.0
"""Mean squared disagreement over its expectation above which exposures contradict each other."""

_MOVED_BOX = 5
"""Side of the box over which disagreement is averaged, pixels."""

_MOVED_LEVELS = 255 / (2 * _MOVED)
"""Steps in which disagreement is stored; more than twice the limit counts as that, so that masks do not grow."""

_LOG_OFFSET = 16.0
"""Standard deviations of the dark that are added before the logarithm, so that negative noise passes through it."""

_LOG_ZERO, _LOG_MAX = 6_000.0, 65_000.0
"""Codes of zero and of the brightest value that can occur; those below zero reach down to -10 standard deviations."""


@dataclass
class Merged:
    """A bracket as one image.

    Attributes
    ----------
    codes
        (H, W, 3) uint16 RGB; `radiance` decodes them. Vignetting and white balance are corrected.
    table
        (65536,) float32 radiance of each code, sensor ranges per second.
    saturated, moved, noisy
        (H, W) bool: clipped in the shortest exposure, exposures contradict each other, below the noise of the longest.
    clipped
        Share of the pixels that each exposure clips, longest first.
    noise
        Of the sensor, as used.
    floor
        Standard deviation of a dark pixel's radiance.
    """

    codes: np.ndarray
    table: np.ndarray
    saturated: np.ndarray
    moved: np.ndarray
    noisy: np.ndarray
    clipped: list[float]
    noise: Noise
    floor: float


@dataclass(frozen=True)
class Gains:
    """What a mosaic is multiplied by before it is demosaiced: white balance, and one over the vignetting."""

    white_balance: np.ndarray = field(default_factory=lambda: np.ones(3))
    vignetting: Vignetting | None = None

    def by_color(self) -> np.ndarray:
        """(4,) float32 gains by colour index: red, green, blue, second green."""
        return np.asarray(self.white_balance, np.float32)[[0, 1, 2, 1]]

    def apply(self, strip: np.ndarray, first: int) -> None:
        """Divide a strip of rows from row ``first`` by the vignetting, in place; (rows, W[, 3])."""
        if self.vignetting is None:
            return
        rows = np.arange(first, first + strip.shape[0], dtype=np.float32)[:, None] + np.float32(0.5)
        columns = np.arange(strip.shape[1], dtype=np.float32)[None] + np.float32(0.5)
        falloff = self.vignetting.falloff(columns, rows)
        strip /= falloff if strip.ndim == 2 else falloff[..., None]


@dataclass(frozen=True)
class _Bracket:
    """What turns raw values of a bracket into signals, and signals into weights.

    Attributes
    ----------
    frames
        Longest exposure first.
    e
        (K,) float32 exposures.
    black, scale, limit, balance
        (8, W) of a strip: black level, one over the range, raw value from which a pixel is full, white balance.
    photon, dark
        Variance of a signal z is photon z + dark.
    saturation
        Share of the range above which a pixel is full.
    """

    frames: Sequence[RawFrame]
    e: np.ndarray
    black: np.ndarray
    scale: np.ndarray
    limit: np.ndarray
    balance: np.ndarray
    photon: np.float32
    dark: np.float32
    saturation: float


@dataclass(frozen=True)
class _Strip:
    """Signals of some rows, (n, W) each.

    Attributes
    ----------
    signals
        Of every frame, float32.
    usable
        Where every frame is not full; None: all of it, which saves most of the work.
    light, time
        Sums of usable signals and of their exposures.
    full
        Where no frame is usable.
    lost
        Full pixels of every frame.
    """

    signals: list[np.ndarray]
    usable: list[np.ndarray | None]
    light: np.ndarray
    time: np.ndarray
    full: np.ndarray
    lost: np.ndarray


def merge_mosaics(
    frames: Sequence[RawFrame],
    exposures: Sequence[float],
    black: np.ndarray,
    noise: Noise,
    gains: Gains,
    saturation: float,
    motion: float,
) -> Merged:
    """Merge mosaics with inverse-variance weights, then demosaic once.

    Saturation is decided on raw values. The weight of a frame is e^2 / (gain e L + read^2), one over the variance of
    its radiance, where L is the plain mean (sum of signals over sum of exposures); clipped pixels have none.
    Demosaicing works on logarithms: edges have the same height there in light and in shadow.

    Parameters
    ----------
    frames, exposures
        Longest first.
    black
        (4,) black level by colour index.
    noise
        Of the sensor at the frames' ISO.
    gains
        White balance and vignetting.
    saturation, motion
        Share of the range above which a pixel is full; relative disagreement of exposures that is tolerated beyond
        noise (0: motion is not searched for).
    """
    (height, width), pattern = frames[0].shape, frames[0].pattern
    bracket = _bracket(frames, exposures, black, noise, gains, saturation)
    e, floor = bracket.e, float(np.sqrt(bracket.dark) / bracket.e[0])
    offset, step = _coding(bracket, gains, floor)
    codes = np.empty((height, width), np.uint16)
    saturated, noisy = np.zeros((height, width), bool), np.empty((height, width), np.uint8)
    disagreement, clipped = np.zeros((height, width), np.uint8), np.zeros(len(frames))
    brightness = np.float32(e[0] / noise_limit(bracket.photon, bracket.dark) * 64)
    for top in range(0, height, _STRIP):
        rows = slice(top, min(top + _STRIP, height))
        strip = _strip(bracket, rows)
        clipped += strip.lost
        if (shortest := strip.usable[-1]) is not None:
            saturated[rows] = ~shortest
        value = _merged(bracket, strip)
        if motion > 0 and len(frames) > 1:
            disagreement[rows] = _disagreement(bracket, strip, value, np.float32(motion**2))
        noisy[rows] = np.clip(value * brightness, 0, 255)
        value *= bracket.balance[: len(value)]
        gains.apply(value, top)
        codes[rows] = encode(value, offset, step)
    return Merged(
        codes=demosaic(codes, pattern),
        table=decoding_table(offset, step),
        saturated=_solid(saturated),
        moved=cv2.blur(disagreement, (_MOVED_BOX, _MOVED_BOX)) > _MOVED * _MOVED_LEVELS,
        noisy=cv2.blur(noisy, (4, 4)) < 64,
        clipped=(clipped / (height * width)).tolist(),
        noise=noise,
        floor=floor,
    )


def _coding(bracket: _Bracket, gains: Gains, floor: float) -> tuple[float, float]:
    """Offset and step of `encode` for a bracket whose dark pixels have the standard deviation ``floor``."""
    largest = float(bracket.balance.max())
    offset = _LOG_OFFSET * floor * largest
    brightest = 1.05 / bracket.e[-1] * largest * _largest_gain(gains, bracket.frames[0].shape)
    return offset, np.log1p(brightest / offset) / (_LOG_MAX - _LOG_ZERO)


def _bracket(
    frames: Sequence[RawFrame],
    exposures: Sequence[float],
    black: np.ndarray,
    noise: Noise,
    gains: Gains,
    saturation: float,
) -> _Bracket:
    """Bring levels and noise to signals, over the pattern of a strip."""
    first, span = frames[0], frames[0].white - black

    def spread(values: np.ndarray) -> np.ndarray:
        return tiled(values, first.pattern, _STRIP, first.shape[1])

    return _Bracket(
        frames=frames,
        e=np.array(exposures, np.float32),
        black=spread(black.astype(np.float32)),
        scale=spread((1 / span).astype(np.float32)),
        limit=spread(np.floor(black + saturation * span).astype(np.uint16)),
        balance=spread(gains.by_color()),
        photon=np.float32(noise.gain / span.mean()),
        dark=np.float32((noise.read / span.mean()) ** 2),
        saturation=saturation,
    )


def _strip(bracket: _Bracket, rows: slice) -> _Strip:
    """Read some rows of all frames as signals."""
    n, width = rows.stop - rows.start, bracket.black.shape[1]
    signals: list[np.ndarray] = []
    usable: list[np.ndarray | None] = []
    losses: list[int] = []
    light, time = np.zeros((n, width), np.float32), np.zeros((n, width), np.float32)
    for frame, e in zip(bracket.frames, bracket.e, strict=True):
        raw = frame.mosaic[rows]
        good = raw < bracket.limit[:n]
        lost = good.size - np.count_nonzero(good)
        z = raw - bracket.black[:n]
        z *= bracket.scale[:n]
        signals.append(z)
        usable.append(good if lost else None)
        losses.append(int(lost))
        light += z * good if lost else z
        time += good * e if lost else e
    return _Strip(signals, usable, light, time, time == 0, np.array(losses))


def _merged(bracket: _Bracket, strip: _Strip) -> np.ndarray:
    """(n, W) float32 radiance by inverse-variance weights w = e^2 / (photon e L + dark)."""
    mean = strip.light / np.where(strip.full, 1, strip.time)
    positive = np.maximum(mean, 0)
    value, weights = np.zeros_like(mean), np.zeros_like(mean)
    for e, signal, usable in zip(bracket.e, strip.signals, strip.usable, strict=True):
        # Here w lacks one e: value gathers w z / e.
        w = positive * np.float32(bracket.photon * e)
        w += bracket.dark
        np.divide(e, w, out=w)
        if usable is not None:
            w *= usable
        value += w * signal
        w *= e
        weights += w
    # Full in every frame: what the shortest holds is a lower bound.
    return np.where(strip.full, strip.signals[-1] / bracket.e[-1], value / np.where(strip.full, 1, weights))


def encode(value: np.ndarray, offset: float, step: float) -> np.ndarray:
    """Logarithmic uint16 codes of radiance above -``offset``; changes ``value``."""
    value *= np.float32(1 / offset)
    np.maximum(value, np.float32(-0.999), out=value)
    np.log1p(value, out=value)
    value *= np.float32(1 / step)
    value += np.float32(_LOG_ZERO + 0.5)
    return np.clip(value, 0, 65535).astype(np.uint16)


def decoding_table(offset: float, step: float) -> np.ndarray:
    """(65536,) float32 radiance of each code of `encode`."""
    return (offset * np.expm1((np.arange(65536) - _LOG_ZERO) * step)).astype(np.float32)


def noise_limit(photon: float | np.float32, dark: float | np.float32) -> float:
    """Signal that equals its own standard deviation."""
    return float((photon + np.sqrt(photon**2 + 4 * dark)) / 2)


def _disagreement(bracket: _Bracket, strip: _Strip, value: np.ndarray, tolerance: np.float32) -> np.ndarray:
    """Squared differences between frames and merged value over their expectation, as uint8 steps."""
    total, count = np.zeros_like(value), np.zeros_like(value)
    for e, z, good in zip(bracket.e, strip.signals, strip.usable, strict=True):
        expected = value * e
        variance = np.maximum(expected, 0)
        variance *= tolerance * variance + bracket.photon
        variance += bracket.dark
        difference = z - expected
        difference *= difference
        difference /= variance
        if good is None:
            total += difference
            count += 1
            continue
        # A clipped frame contradicts the others where they say that it should not be.
        counted = good | (~strip.full & (expected < np.float32(0.9 * bracket.saturation)))
        total += difference * counted
        count += counted
    # The merged value takes one degree of freedom.
    total *= np.float32(_MOVED_LEVELS)
    total /= np.maximum(count - 1, 1)
    total *= count > 1
    return np.minimum(total, 255).astype(np.uint8)


def _solid(mask: np.ndarray) -> np.ndarray:
    """Close a mask over the mosaic: a pixel between those of one clipped colour has that colour clipped too."""
    if not mask.any():
        return mask
    kernel = np.ones((3, 3), np.uint8)
    return cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, kernel).view(bool)


def _largest_gain(gains: Gains, shape: tuple[int, int]) -> float:
    if gains.vignetting is None:
        return 1.0
    height, width = shape
    edge = np.linspace(0, 1, 65, dtype=np.float32)
    x, y = np.meshgrid(edge * width, edge * height)
    return float(1 / max(gains.vignetting.falloff(x, y).min(), 0.02))


def merge_hat(
    frames: Sequence[RawFrame],
    exposures: Sequence[float],
    black: np.ndarray,
    gains: Gains,
) -> np.ndarray:
    """Demosaic each exposure, then merge with the hat weights of the paper's supplement (B.1).

    The weight of a signal z in [0, 1] is min(2 z, 2 (1 - z)) clipped to [0, 1], except that the longest exposure keeps
    1 in its dark half and the shortest in its bright half, so that every pixel has a value.

    Returns
    -------
    (H, W, 3) float32 radiance in sensor ranges per second, vignetting and white balance corrected.
    """
    height, width = frames[0].shape
    first = frames[0]
    span = first.white - black
    pedestal = 1024.0  # room for negative noise in 16 bits
    total, weights = np.zeros((height, width, 3), np.float32), np.zeros((height, width, 3), np.float32)
    for k, frame in enumerate(frames):
        scale = (65535.0 - pedestal) / span * 0.999
        shifted = frame.mosaic - tiled(black.astype(np.float32), first.pattern, height, width)
        shifted *= tiled(scale.astype(np.float32), first.pattern, height, width)
        rgb = demosaic(np.clip(shifted + (pedestal + 0.5), 0, 65535).astype(np.uint16), first.pattern)
        z = (rgb - np.float32(pedestal)) / np.float32((65535.0 - pedestal) * 0.999)
        w = np.clip(2 * np.minimum(z, 1 - z), 0, 1)
        if k == 0:
            w = np.where(z < 0.5, 1, w)
        if k == len(frames) - 1:
            w = np.where(z >= 0.5, 1, w)
        total += w * z / np.float32(exposures[k])
        weights += w
    radiance = total / np.maximum(weights, 1e-9)
    radiance *= np.float32(gains.white_balance)
    gains.apply(radiance, 0)
    return radiance
