"""Calibration frames on disk, and what all kinds of them need."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.folder import photographs
from fipt.stages.capture.mosaic import tiled
from fipt.stages.capture.raw import RawFrame, read_raw

FOLDER = "calibration"
"""Subfolder of a capture folder that holds calibration frames in folders named by kind."""

KINDS = ("dark", "flat", "checkerboard", "charuco", "white")


def calibration_frames(folder: Path) -> dict[str, list[Path]]:
    """Kind -> its frames in ``folder/calibration/KIND/``; kinds without frames are left out."""
    frames = {}
    for kind in KINDS:
        place = folder / FOLDER / kind
        if place.is_dir() and any(place.iterdir()):
            frames[kind] = photographs(place)[1]
    return frames


def read_frame(path: Path, found: Calibration) -> RawFrame:
    """Read a calibration frame; raise FiptError if it is of another size than the photographs."""
    frame = read_raw(path)
    found.check_size(frame.shape, path)
    return frame


def signal_of(frame: RawFrame, found: Calibration) -> np.ndarray:
    """(H, W) float32 raw values above black."""
    black = frame.black if found.black is None else np.array(found.black)
    return frame.mosaic - tiled(black.astype(np.float32), frame.pattern, *frame.shape)


def counted(paths: Sequence[Any], what: str) -> str:
    """Say what a part of the calibration is from: ``flat field (4 frames)``."""
    return f"{what} ({len(paths)} frame{'s' if len(paths) != 1 else ''})"
