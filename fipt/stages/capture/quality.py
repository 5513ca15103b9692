"""Figures of a view of RAW photographs, measured on the raw values: known in the room, before anything is developed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fipt.errors import FiptError
from fipt.scene.blocks import block_mean, blocks
from fipt.stages.capture.brackets import Bracket
from fipt.stages.capture.exposures import exposure, measured_ratio
from fipt.stages.capture.noise import assumed_noise, measured_noise
from fipt.stages.capture.raw import RawFrame

FULL = 0.99
"""Share of the range from which a raw value counts as clipped."""

_DIFFERENT = 0.1
"""Relative difference of two exposures of a block from which something has moved there."""

_TELLING = 200
"""Cells that must tell the light of an exposure."""

_BLOCK = 8
"""Side of such a block, cells of the mosaic."""

_LIT = 0.03
"""Share of the range above which a block is compared."""

_NEAR, _FAR = 1, 8
"""Cells over which a sharp edge has risen, and over which any has."""


@dataclass(frozen=True)
class BracketFrame:
    """One exposure of a view.

    Attributes
    ----------
    file
        Name of the file.
    shutter
        Seconds as the camera states them.
    stops
        Exposure relative to the longest one of the view, stops (0, then negative).
    light
        Light that it gathered over what the other exposures of the view tell, by the median; None where they do not.
    ratio, measured
        Exposure of the next longer frame over this one: as stated, and measured from pixels that both see well; None
        for the longest, and where too few pixels tell.
    """

    file: str
    shutter: float
    stops: float
    ratio: float | None
    measured: float | None
    light: float | None = None


@dataclass(frozen=True)
class Quality:
    """Figures of a view.

    Attributes
    ----------
    view
        Its name.
    frames
        Exposures, longest first.
    clipped
        Share of pixels clipped in the shortest exposure: their radiance is only a lower bound.
    noisy
        Share of pixels darker than the read noise in the longest exposure.
    dynamic_range
        From the noise of the longest to saturation of the shortest exposure, stops.
    sharpness
        Share of the strongest edges' height within one cell of the mosaic, about 1 sharp, 0.2 badly blurred; of
        developed views, their steepness. Good for comparing views of a capture with each other.
    moved
        Share of the image where exposures disagree.
    white_balance
        Gains of red, green and blue as the camera has them; None where it has none.
    """

    view: str
    frames: tuple[BracketFrame, ...]
    clipped: float
    noisy: float
    dynamic_range: float
    sharpness: float
    moved: float
    white_balance: tuple[float, float, float] | None


def measure(bracket: Bracket, frames: Sequence[RawFrame]) -> Quality:
    """Measure a view.

    Parameters
    ----------
    bracket
        Its photographs, longest exposure first.
    frames
        Their mosaics, in the same order.

    Raises
    ------
    FiptError
        If the frames are of different size.
    """
    check_sizes(bracket.view, frames)
    exposures = [exposure(shot) for shot in bracket.shots]
    ratios = [a / b for a, b in pairwise(exposures)]
    measured = [
        measured_ratio(longer, shorter, longer.black, ratio)
        for longer, shorter, ratio in zip(frames, frames[1:], ratios, strict=False)
    ]
    greens, full = [_green(frame) for frame in frames], [_clipped(frame) for frame in frames]
    sensor = measured_noise(frames, exposures, frames[0].black) or assumed_noise(frames[0], frames[0].black)
    noise = sensor.read / float(np.mean(frames[0].range))
    gains = frames[0].white_balance
    best = max(greens, key=lambda green: float(((green > 0.05) & (green < 0.9)).mean()))
    return Quality(
        view=bracket.view,
        frames=tuple(
            BracketFrame(shot.path.name, shot.seconds, math.log2(value / exposures[0]), ratio, found, light)
            for shot, value, ratio, found, light in zip(
                bracket.shots,
                exposures,
                (None, *ratios),
                (None, *measured),
                _gathered(greens, exposures, noise),
                strict=True,
            )
        ),
        clipped=float(full[-1].mean()),
        noisy=float((greens[0] < noise).mean()),
        dynamic_range=math.log2(exposures[0] / exposures[-1] / noise),
        sharpness=_sharpness(best),
        moved=_moved(greens, full, measured),
        white_balance=None if gains is None else (float(gains[0]), float(gains[1]), float(gains[2])),
    )


def _gathered(greens: Sequence[np.ndarray], exposures: Sequence[float], noise: float) -> list[float | None]:
    """Light of each exposure over what another one tells of it: the nearest that is neither dark nor clipped there."""
    found: list[float | None] = []
    for k, green in enumerate(greens):
        others = sorted(
            (j for j in range(len(greens)) if j != k), key=lambda j: abs(math.log(exposures[j] / exposures[k]))
        )
        share = None
        for j in others:
            expected = greens[j] * np.float32(exposures[k] / exposures[j])
            known = (
                (greens[j] > max(0.02, 10 * noise)) & (greens[j] < 0.85) & (expected > 10 * noise) & (expected < 0.85)
            )
            if known.sum() >= _TELLING:
                share = float(np.median(green[known] / expected[known]))
                break
        found.append(share)
    return found


def check_sizes(view: str, frames: Sequence[RawFrame]) -> None:
    """Raise FiptError if the frames of a view are of different size or mosaic."""
    usual = Counter((frame.shape, frame.pattern.tobytes()) for frame in frames).most_common(1)[0][0]
    for frame in frames:
        if (frame.shape, frame.pattern.tobytes()) != usual:
            (rows, columns), (height, width) = frame.shape, usual[0]
            raise FiptError(
                f"view {view}: the frames of a bracket must have one size and mosaic; {frame.shot.path.name} is "
                f"{columns}x{rows}, the others {width}x{height}",
                "remove it, or photograph the view again",
            )


def _planes(frame: RawFrame, color: int) -> list[np.ndarray]:
    """(H/2, W/2) raw values of each position of the cell with this colour (both greens count as 1)."""
    rows, columns = (size // 2 * 2 for size in frame.shape)
    return [
        frame.mosaic[i:rows:2, j:columns:2]
        for i in range(2)
        for j in range(2)
        if frame.pattern[i, j] == color or (color == 1 and frame.pattern[i, j] == 3)
    ]


def _green(frame: RawFrame) -> np.ndarray:
    """(H/2, W/2) float32 mean of the two greens of each cell, as a share of the range."""
    greens = _planes(frame, 1)
    black = np.mean([frame.black[1], frame.black[3]])
    span = np.mean([frame.range[1], frame.range[3]])
    total = greens[0].astype(np.float32)
    for plane in greens[1:]:
        total += plane
    return (total / len(greens) - np.float32(black)) / np.float32(span)


def _clipped(frame: RawFrame) -> np.ndarray:
    """(H/2, W/2) bool: cells of which a pixel is clipped."""
    rows, columns = (size // 2 * 2 for size in frame.shape)
    found = np.zeros((rows // 2, columns // 2), bool)
    for i in range(2):
        for j in range(2):
            color = frame.pattern[i, j]
            limit = frame.black[color] + FULL * frame.range[color]
            found |= frame.mosaic[i:rows:2, j:columns:2] >= limit
    return found


def _sharpness(green: np.ndarray) -> float:
    """Height of the strongest edges within `_NEAR` cells over that within `_FAR` cells."""
    # Square root: about the same noise everywhere, and a lamp's edge does not decide alone.
    image = np.sqrt(np.clip(green, 0.0, 1.0))
    steps = []
    for distance in (_NEAR, _FAR):
        across = np.abs(image[:, distance:] - image[:, :-distance])
        down = np.abs(image[distance:] - image[:-distance])
        steps.append(max(np.quantile(across, 0.999), np.quantile(down, 0.999)))
    return float(steps[0] / max(steps[1], 1e-6))


def _moved(greens: Sequence[np.ndarray], full: Sequence[np.ndarray], ratios: Sequence[float | None]) -> float:
    """Share of blocks whose exposures disagree, among all blocks.

    ``full`` are the clipped cells, ``ratios`` measured: stated ones may be wrong for the whole image.
    """
    rows, columns = (size // _BLOCK for size in greens[0].shape)
    if rows == 0 or columns == 0:
        return 0.0

    means = [block_mean(green, _BLOCK) for green in greens]
    whole = [~blocks(cells, _BLOCK).any(axis=(1, 3)) for cells in full]
    found = np.zeros((rows, columns), bool)
    for k, ratio in enumerate(ratios):
        if ratio is None:
            continue
        expected, seen = means[k] / ratio, means[k + 1]
        brighter = np.maximum(expected, seen)
        found |= whole[k] & whole[k + 1] & (brighter > _LIT) & (np.abs(expected - seen) > _DIFFERENT * brighter)
    return float(found.mean())
