"""The sensor's noise: as a bracket shows it, or as usual sensors have it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from fipt.robust import spread
from fipt.stages.capture.calibration import Noise
from fipt.stages.capture.raw import RawFrame

_FULL_WELL, _READ = 40_000.0, 2.0**-12.5
"""Electrons at full range at ISO 100, and read noise over the range: assumed where nothing tells."""


def assumed_noise(frame: RawFrame, black: np.ndarray) -> Noise:
    """Noise of a usual sensor, for a bracket that does not tell its own."""
    span = float((frame.white - black).mean())
    iso = frame.shot.iso or 100.0
    return Noise(span / _FULL_WELL * iso / 100, max(span * _READ, 0.5), iso)


def measured_noise(frames: Sequence[RawFrame], exposures: Sequence[float], black: np.ndarray) -> Noise | None:
    """Noise of the sensor from the differences of overlapping exposures; None where they do not tell.

    A frame's difference to the next longer one, scaled to it, has the variance gain z (1 + 1/r) + read^2 (1 + 1/r^2)
    at signal z and ratio r of exposures. Pixels are sorted by what the longer one says; the spread within a bin is
    the median one, so that motion and edges do not count.
    """
    rows, columns = frames[0].shape
    stride = 2 * (max(1, int(np.sqrt(rows * columns / 300_000))) // 2) + 1
    phase = frames[0].pattern[np.ix_(np.arange(0, rows, stride) & 1, np.arange(0, columns, stride) & 1)]
    offset, full = black[phase], frames[0].white[phase]
    samples = [
        np.where(f.mosaic[::stride, ::stride] < 0.95 * full, f.mosaic[::stride, ::stride] - offset, np.nan)
        for f in frames
    ]
    design, target, importance = [], [], []
    for k, (long, short) in enumerate(pairwise(samples)):
        ratio = exposures[k] / exposures[k + 1]
        expected = long / ratio
        use = np.isfinite(long) & np.isfinite(short)
        difference, expected = (short - expected)[use], expected[use]
        # Ratios of exposures are a little off; from a few hundred units on, that would pass for noise.
        edges = np.concatenate([[-np.inf], np.geomspace(4, 0.1 * np.median(full), 10)])
        for low, high in pairwise(edges):
            inside = (expected >= low) & (expected < high)
            if inside.sum() < 200:
                continue
            noise = spread(difference[inside])
            design.append((max(float(expected[inside].mean()), 0.0) * (1 + 1 / ratio), 1 + 1 / ratio**2))
            target.append(noise**2)
            importance.append(np.sqrt(inside.sum()) / max(noise**2, 0.1))
    if len(target) < 3:
        return None
    weight = np.array(importance)
    from scipy.optimize import nnls

    (gain, read2), _ = nnls(np.array(design) * weight[:, None], np.array(target) * weight)
    if gain <= 0:
        return None
    return Noise(float(gain), float(np.sqrt(max(read2, 1 / 12))), frames[0].shot.iso or 100.0)
