"""Calibration frames on disk, and what all kinds of them need."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.folder import photographs
from fipt.stages.capture.mosaic import tiled
from fipt.stages.capture.raw import RawFrame, read_raw

FOLDER = "calibration"
"""Subfolder of a capture folder that holds calibration frames in folders named by kind."""

KINDS = ("dark", "flat", "checkerboard", "charuco", "white")


def calibration_frames(folder: Path) -> dict[str, list[Path]]:
    """Kind -> its frames in ``folder/calibration/KIND/``; kinds without frames are left out.

    Raises
    ------
    FiptError
        If something else lies there: frames of a kind that is not known would be passed over.
    """
    root = folder / FOLDER
    if not root.exists():
        return {}
    there = [place for place in (sorted(root.iterdir()) if root.is_dir() else [root]) if place.name[0] != "."]
    for place in there:
        if place.name not in KINDS or not place.is_dir():
            raise FiptError(
                f"{place} is no folder of calibration frames: {', '.join(KINDS)} in {root} are",
                "rename it, or move it elsewhere",
            )
    full = [place for place in there if any(file.name[0] != "." for file in place.iterdir())]
    return {kind: photographs(root / kind)[1] for kind in KINDS if root / kind in full}


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
