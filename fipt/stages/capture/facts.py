"""What is known of a developed view, for the capture report: VIEW.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED, LUMINANCE
from fipt.stages.capture.brackets import Bracket
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.merge import Merged
from fipt.stages.capture.raw import RawFrame
from fipt.stages.capture.view import View

_CLIPPED_SHORTEST = 0.01
"""Share of clipped pixels in the shortest exposure above which a view is warned about."""

_PIXELS_JUDGED = 1_000_000
"""Pixels from which percentiles are taken for the report."""


def raw_facts(
    frames: Sequence[RawFrame],
    exposures: Sequence[float],
    ratios: list[dict[str, Any]],
    merged: Merged,
    calibration: Calibration,
) -> dict[str, Any]:
    """What only the raw frames tell."""
    balance = next((frame.white_balance for frame in frames if frame.white_balance is not None), None)
    warnings = [
        f"{ratio['longer']} to {ratio['shorter']}: the exposures' ratio is {ratio['measured']:.3f}, "
        f"not {ratio['stated']:.3f}"
        for ratio in ratios
        if ratio["differs"]
    ]
    if merged.clipped[-1] > _CLIPPED_SHORTEST:
        warnings.append(f"{merged.clipped[-1]:.1%} of the pixels are clipped in the shortest exposure")
    bracket = Bracket("", "raw", tuple(frame.shot for frame in frames))
    return {
        "exposures": exposure_facts(bracket, exposures, merged.clipped),
        "ratios": ratios,
        "noise": asdict(merged.noise),
        "measurable_stops": float(np.log2(1 / exposures[-1] / merged.floor)),
        "camera_white_balance": None if balance is None else balance.tolist(),
        "bad_pixels": len(calibration.bad_pixels),
        "warnings": warnings,
    }


def exposure_facts(bracket: Bracket, exposures: Sequence[float], clipped: Sequence[float]) -> list[dict[str, Any]]:
    """One entry an exposure, longest first: the file, what it states, the exposure used, its clipped share."""
    return [
        {
            "file": shot.path.name,
            "shutter": shot.shutter,
            "aperture": shot.aperture,
            "iso": shot.iso,
            "focal_length": shot.focal_length,
            "exposure": value,
            "clipped": share,
        }
        for shot, value, share in zip(bracket.shots, exposures, clipped, strict=True)
    ]


def view_facts(bracket: Bracket, view: View, calibration: Calibration) -> dict[str, Any]:
    """What every view tells; JSON types."""
    step = max(1, int(np.sqrt(view.valid.size / _PIXELS_JUDGED)))
    good = view.radiance[::step, ::step][view.valid[::step, ::step] > 0.5] @ np.array(LUMINANCE, np.float32)
    low, high = np.percentile(good, (1, 99.9)) if good.size else (0.0, 0.0)
    low = max(low, view.floor, 1e-12)
    shares = {
        name: np.count_nonzero(view.flags & bit) / view.flags.size
        for name, bit in (
            ("saturated", FLAG_SATURATED),
            ("noisy", FLAG_NOISE),
            ("outside", FLAG_OUTSIDE),
            ("moved", FLAG_MOVED),
        )
    }
    lens = view.lens
    return {
        "view": bracket.view,
        "kind": bracket.kind,
        "ldr": bracket.kind == "ldr",
        "width": view.valid.shape[1],
        "height": view.valid.shape[0],
        "camera": None
        if lens is None
        else {"w": lens.width, "h": lens.height, "fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy},
        "shares": shares,
        "valid": float(view.valid.mean()),
        "scene_stops": float(np.log2(max(high / low, 1.0))),
        "sharpness": sharpness(view),
        "white_balance": list(calibration.white_balance),
        "sources": calibration.sources,
        "time": min((shot.time for shot in bracket.shots if shot.time is not None), default=None),
        "orientation": bracket.shots[0].orientation,
        "warnings": [],
    }


def sharpness(view: View) -> float:
    """Steepest edges of a view: 99.5th percentile of the change of luminance between neighbours, stops a pixel.

    Light below 20 times the noise, and pixels without weight, are left out. Of large views, bands of rows are judged.
    """
    height, width = view.valid.shape
    bands = max(1, min(height // 64, _PIXELS_JUDGED // (64 * width)))
    changes = []
    for top in np.linspace(0, max(height - 64, 0), bands).astype(int):
        rows = slice(top, top + 64)
        luminance = view.radiance[rows] @ np.array(LUMINANCE, np.float32)
        floor = max(20 * view.floor, 1e-3 * float(np.median(luminance)), 1e-12)
        stops = cv2.GaussianBlur(np.log2(np.maximum(luminance, floor)), (3, 3), 0)
        change = np.hypot(cv2.Sobel(stops, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(stops, cv2.CV_32F, 0, 1) / 8)
        good = cv2.erode((view.valid[rows] > 0.99).view(np.uint8), np.ones((5, 5), np.uint8)) > 0
        changes.append(change[good])
    judged = np.concatenate(changes)
    return float(np.percentile(judged, 99.5)) if judged.size else 0.0
