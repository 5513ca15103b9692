"""White balance and colour matrix of a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import XYZ_FROM_SRGB
from fipt.errors import FiptError
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.calibration_frames import counted, read_frame, signal_of
from fipt.stages.capture.raw import RawFrame
from fipt.stages.capture.settings import CaptureSettings


def with_white(
    found: Calibration, paths: Sequence[Path], settings: CaptureSettings, first: RawFrame, bar: Any
) -> Calibration:
    """Gains from the middle of the white frames, else those of the capture's first frame."""
    gains, source = np.ones(3), "nothing (gains 1)"
    if settings.white_balance == "reference" and paths:
        colors = []
        for path in paths:
            frame = read_frame(path, found)
            signal = signal_of(frame, found)
            height, width = (n // 4 * 2 for n in frame.shape)
            middle = signal[height // 4 * 2 :, width // 4 * 2 :][:height, :width]
            light = np.zeros(4)
            for (i, j), color in np.ndenumerate(frame.pattern):
                light[color] = np.mean(middle[i::2, j::2])
            if (light > 0.95 * frame.range).any() or (light < 0.01 * frame.range).any():
                shares = ", ".join(f"{share:.0%}" for share in (light / frame.range)[:3])
                raise FiptError(
                    f"{path} must show white between 1 and 95 % of the sensor range; red, green, blue are at {shares}",
                    "photograph the white reference with another exposure",
                )
            light /= frame.range
            colors.append([light[0], (light[1] + light[3]) / 2, light[2]])
            bar.advance()
        mean = np.mean(colors, axis=0)
        gains, source = mean[1] / mean, counted(paths, "white reference")
    elif settings.white_balance != "none" and first.white_balance is not None:
        gains, source = first.white_balance, f"the camera ({first.shot.path.name})"
    return replace(
        found,
        white_balance=tuple(float(gain) for gain in gains),
        sources={**found.sources, "white_balance": source},
    )


def with_color(found: Calibration, camera_from_xyz: np.ndarray | None) -> Calibration:
    """Linear sRGB from white-balanced camera RGB, both with white at (1, 1, 1)."""
    if camera_from_xyz is None:
        return replace(found, absent=(*found.absent, "no colour matrix is known: colours stay the camera's own"))
    camera_from_srgb = camera_from_xyz @ XYZ_FROM_SRGB
    matrix = np.linalg.inv(camera_from_srgb / camera_from_srgb.sum(axis=1, keepdims=True))
    return replace(
        found,
        color=tuple(map(tuple, matrix.tolist())),
        sources={**found.sources, "color": "colour matrix of the camera"},
    )
