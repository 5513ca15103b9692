"""Intrinsics and distortion of a lens: from boards, else by its name, else its focal length alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.scene import boards
from fipt.scene.lens import Lens
from fipt.scene.sources import EXIF_LENS
from fipt.stages.capture import lensfun
from fipt.stages.capture.calibration import Calibration, Vignetting
from fipt.stages.capture.calibration_frames import counted, read_frame, signal_of
from fipt.stages.capture.mosaic import tiled
from fipt.stages.capture.raw import LDR_SUFFIXES, Shot
from fipt.stages.capture.settings import CaptureSettings

_BINOMIAL = np.array([0.25, 0.5, 0.25])

_MODELS = {
    "k1, k2": cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    "k1, k2, k3": cv2.CALIB_ZERO_TANGENT_DIST,
    "k1, k2, p1, p2": cv2.CALIB_FIX_K3,
    "k1, k2, p1, p2, k3": 0,
}
"""Distortion models, simplest first."""

_WORTH = 0.95
"""Reprojection error of a richer model over that of a simpler one, at most."""


def with_lens(
    found: Calibration,
    frames: dict[str, list[Path]],
    settings: CaptureSettings,
    shot: Shot,
    bar: Any = None,
) -> Calibration:
    """Intrinsics and distortion: from boards, else by the lens's name, else the focal length alone."""
    for kind, corners_of in (("charuco", _charuco_corners), ("checkerboard", _checkerboard_corners)):
        if kind in frames:
            return _from_boards(found, kind, frames[kind], corners_of, settings, bar)
    if settings.lensfun and shot.lens:
        fallback = lensfun.find_lens(shot, found.width, found.height, settings.lensfun_distance)
        if fallback is not None:
            return _with_lensfun(found, *fallback)
        found = replace(found, absent=(*found.absent, f"lens {shot.lens!r} is not in lensfun's database"))
    if shot.focal_length_35:
        # Equivalents are by diagonal: that of 36 x 24 mm is 43.27 mm.
        f = shot.focal_length_35 / np.hypot(36, 24) * np.hypot(found.width, found.height)
        lens = Lens(found.width, found.height, float(f), float(f), found.width / 2, found.height / 2)
        return replace(found, lens=lens, sources={**found.sources, "lens": EXIF_LENS})
    return found


def _with_lensfun(found: Calibration, name: str, lens: Lens, vignetting: Vignetting | None) -> Calibration:
    sources = {**found.sources, "lens": f"lensfun: {name}"}
    if found.vignetting is None and vignetting is not None:
        found = replace(found, vignetting=vignetting)
        sources["vignetting"] = sources["lens"]
    return replace(found, lens=lens, sources=sources)


def _from_boards(
    found: Calibration, kind: str, paths: Sequence[Path], corners_of: Any, settings: CaptureSettings, bar: Any
) -> Calibration:
    objects, images, used = [], [], []
    for path in paths:
        corners = corners_of(_grey(path, found), settings)
        if corners is not None:
            objects.append(corners[0].astype(np.float32))
            images.append(corners[1].astype(np.float32))
            used.append(path.name)
        if bar is not None:
            bar.advance()
    size = f"{settings.board_columns}x{settings.board_rows} inner corners"
    if not used:
        names = ", ".join(path.name for path in paths)
        raise FiptError(
            f"no {kind} of {size} was found in any of {len(paths)} frames of {paths[0].parent}: {names}",
            "check capture.board_columns and board_rows; the whole board must be visible, sharp and evenly lit",
        )
    if len(used) < 3:
        raise FiptError(
            f"a {kind} of {size} must be found in at least 3 frames of {paths[0].parent}; found in {len(used)} of "
            f"{len(paths)}: {', '.join(used)}",
            "photograph the board from more sides",
        )
    lens, rms, model = _solved(objects, images, (found.width, found.height))
    figures = {"kind": kind, "rms": rms, "frames": used, "not_found": len(paths) - len(used), "model": model}
    return replace(
        found,
        lens=lens,
        sources={**found.sources, "lens": counted(used, kind)},
        figures={**found.figures, "board": figures},
    )


def _solved(
    objects: Sequence[np.ndarray], images: Sequence[np.ndarray], shape: tuple[int, int]
) -> tuple[Lens, float, str]:
    """Lens with the fewest terms that explains the corners; its reprojection error in pixels, and its model."""
    best, model = None, ""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # several sum in an order of their own each time: distortion differed in the eighth digit
    try:
        # A richer model must pay: one that follows the noise of the corners bends the corners of the image.
        for name, flags in _MODELS.items():
            rms, matrix, distortion, _, _ = cv2.calibrateCamera(objects, images, shape, None, None, flags=flags)
            if best is None or rms < _WORTH * best[0]:
                best, model = (rms, matrix, distortion.ravel()[:5]), name
    finally:
        cv2.setNumThreads(threads)
    assert best is not None
    rms, matrix, (k1, k2, p1, p2, k3) = best[0], best[1], map(float, best[2])
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens(*shape, fx, fy, cx, cy, (k1, k2, p1, p2, k3)), float(rms), model


def _checkerboard_corners(grey: np.ndarray, settings: CaptureSettings) -> tuple[np.ndarray, np.ndarray] | None:
    size = (settings.board_columns, settings.board_rows)
    ok, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not ok:
        return None
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    points = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).reshape(-1, 3) * settings.board_square
    return points, boards.refined(grey, corners.reshape(-1, 2), 0.4) + 0.5


def _charuco_corners(grey: np.ndarray, settings: CaptureSettings) -> tuple[np.ndarray, np.ndarray] | None:
    markers = boards.dictionary(settings.board_dictionary, "capture.board_dictionary")
    inner = (settings.board_columns, settings.board_rows)
    board = boards.charuco_board(inner, settings.board_square, settings.board_marker, markers)
    found = boards.charuco_corners(grey, board, 8)
    return None if found is None else found[:2]


def _grey(path: Path, found: Calibration) -> np.ndarray:
    """(H, W) uint8 image for corner detection: the square root of the light, vignetting corrected."""
    if path.suffix.lower() in LDR_SUFFIXES:
        from fipt.stages.capture.ldr import read_ldr

        image = read_ldr(path)
        found.check_size(image.shape[:2], path)
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    frame = read_frame(path, found)
    light = signal_of(frame, found) / tiled(frame.range.astype(np.float32), frame.pattern, *frame.shape)
    # Boards are grey: with its colours brought to one level, the mosaic is a grey image of full resolution.
    for i, j in np.ndindex(2, 2):
        light[i::2, j::2] /= max(float(light[i::2, j::2].mean()), 1e-6)
    if found.vignetting is not None:
        rows, columns = (np.arange(n, dtype=np.float32) + np.float32(0.5) for n in frame.shape)
        light /= found.vignetting.falloff(columns[None], rows[:, None])
    # (1, 2, 1) / 4 in both directions cancels what the mosaic leaves of a colour cast exactly.
    light = cv2.sepFilter2D(light, cv2.CV_32F, _BINOMIAL, _BINOMIAL)
    top = 1.05 * np.percentile(light[::7, ::7], 99.5)
    return (np.sqrt(np.clip(light / top, 0, 1)) * 255 + 0.5).astype(np.uint8)
