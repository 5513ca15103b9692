"""The capture's section of the page: figures of every view, findings, calibration."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.text import MALFORMED
from fipt.scene import display
from fipt.scene.dataset import Dataset
from fipt.stages.report import images

MARKS = {FLAG_SATURATED: (255, 0, 144), FLAG_MOVED: (0, 200, 255)}
"""Colour of clipped pixels, and of those that moved, in the thumbnails."""

_WIDTH = 200
"""Of a thumbnail, pixels."""
_FINDINGS = 40
"""Findings of one kind on the page; qa.json has all."""


@dataclass(frozen=True)
class CaptureView:
    """A photographed view: its figures in words, and a thumbnail (data URI, width, height) where it is accepted."""

    name: str
    reason: str | None
    exposures: str
    ratio: str
    figures: Sequence[str]
    thumbnail: tuple[str, int, int] | None


@dataclass(frozen=True)
class CaptureReport:
    """What the page says about the photographs.

    Attributes
    ----------
    findings
        severity, message, remedy of each, worst first; ``more`` is how many are not shown.
    sources, absent
        Part of the calibration -> where it comes from; what is not known.
    board
        Kind, frames, reprojection error (``rms``, pixels) of the calibration board; None without one.
    measured, fitted
        Vignetting curve: (radius, light) with radius 1 in the corners, as measured in blocks and as fitted.
    """

    views: Sequence[CaptureView]
    findings: Sequence[Mapping[str, str]]
    more: int
    exposure: Mapping[str, Any]
    sources: Mapping[str, str]
    absent: Sequence[str]
    board: Mapping[str, Any] | None
    measured: Sequence[tuple[float, float]]
    fitted: Sequence[tuple[float, float]]


def read_capture(path: Path, data: Dataset | None, exposure: float) -> CaptureReport | None:
    """Read capture/qa.json; None where there is none.

    Parameters
    ----------
    path
        The file.
    data
        The dataset that the views became, for the thumbnails.
    exposure
        Factor on radiance, the page's.
    """
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        calibration, found = content["calibration"], content["findings"]
        curve = calibration["figures"].get("vignetting") or {}
        return CaptureReport(
            views=[_view(name, state, data, exposure) for name, state in content["views"].items()],
            findings=found[:_FINDINGS],
            more=max(len(found) - _FINDINGS, 0),
            exposure=content["exposure"],
            sources=calibration["sources"],
            absent=calibration["absent"],
            board=calibration["figures"].get("board"),
            measured=[(float(r), float(light)) for r, light in curve.get("curve", ())],
            fitted=_fitted(calibration.get("vignetting")),
        )
    except MALFORMED as error:
        raise FiptError(f"{path} is not a capture report ({error!r})", "run fipt qa again") from error


def _view(name: str, state: Mapping[str, Any], data: Dataset | None, exposure: float) -> CaptureView:
    if not state["accepted"]:
        return CaptureView(name, str(state["reason"]), "", "", (), None)
    frames = state["frames"]
    span = f"{-frames[-1]['stops']:.0f} EV" if len(frames) > 1 else ""
    off = [abs(f["measured"] / f["ratio"] - 1) for f in frames if f["measured"] is not None]
    balance = state["white_balance"]
    figures = (
        f"{state['clipped']:.1%}",
        f"{state['noisy']:.1%}",
        f"{state['dynamic_range']:.1f}",
        f"{state['sharpness']:.2f}",
        f"{state['moved']:.1%}",
        "–" if balance is None else f"{balance[0]:.2f}, {balance[2]:.2f}",  # noqa: RUF001 (a dash is meant)
    )
    thumbnail = None
    if data is not None and name in {camera.name for camera in data.cameras}:
        thumbnail = images.embedded(marked(data, name, exposure), _WIDTH)
    return CaptureView(
        name,
        None,
        f"{len(frames)}{f' over {span}' if span else ''}",
        f"{max(off):.1%}" if off else "–",  # noqa: RUF001
        figures,
        thumbnail,
    )


def marked(data: Dataset, view: str, exposure: float) -> np.ndarray:
    """(H, W, 3) uint8 image of a view in which clipped pixels, and those that moved, are marked."""
    pixels = display.tone_mapped(data.image(view)[0], exposure)
    flags = data.flags(view)
    if flags is not None:
        for bit, color in MARKS.items():
            pixels[flags & bit > 0] = color
    return pixels


def _fitted(coefficients: Sequence[float] | None) -> list[tuple[float, float]]:
    """Points of the fitted curve 1 + a1 r^2 + a2 r^4 + ..."""
    if not coefficients:
        return []
    radius = np.linspace(0, 1, 41)
    light = 1.0 + np.sum([a * radius ** (2 * k) for k, a in enumerate(coefficients, start=1)], axis=0)
    return list(zip(radius.tolist(), light.tolist(), strict=True))
