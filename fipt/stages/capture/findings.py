"""What is wrong with a capture, and what to do about it: findings with a severity, worst first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.stages.capture import lensfun
from fipt.stages.capture.brackets import Bracket, Capture, Finding, mixed_shots, views_in_words
from fipt.stages.capture.calibrate import calibrate
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.calibration_frames import calibration_frames
from fipt.stages.capture.exposures import RATIO_TOLERANCE, shutter_text
from fipt.stages.capture.quality import Quality
from fipt.stages.capture.raw import Shot
from fipt.stages.capture.settings import CaptureSettings

SEVERITIES = ("error", "warning", "note")
"""Of findings, worst first. With an error a view, or the capture, cannot be used."""

CLIPPED_SHARE = 0.01
"""Share of pixels that may be clipped in the shortest exposure: lamps; more is a window or a wrong exposure."""

NOISY_SHARE = 0.1
"""Share of pixels that may be darker than the read noise in the longest exposure."""

MOVED_SHARE = 0.005
"""Share of the image that may differ between exposures."""

REPROJECTION = 0.5
"""Root mean square distance of board corners after calibration that is still good, pixels."""

DARK = 0.1
"""Share of the expected light below which an exposure was covered: no lamp dims so much, and no shutter errs so."""

BLURRED = 0.4
"""A view with less than this share of the capture's usual sharpness is blurred."""


def check(capture: Capture, unreadable: Iterable[Finding] = (), qualities: Sequence[Quality] = ()) -> list[Finding]:
    """All findings of a capture, worst first.

    Parameters
    ----------
    capture
        Its brackets, and what was found when they were grouped.
    unreadable
        What was found when the photographs were read.
    qualities
        Figures of the views that could be read.
    """
    found = [*capture.findings, *unreadable, *_mixed(capture.brackets), *_judged(qualities)]
    return sorted(found, key=lambda finding: SEVERITIES.index(finding.severity))


def _mixed(brackets: Sequence[Bracket]) -> list[Finding]:
    """What should be the same in all photographs: aperture, ISO."""
    asked: tuple[tuple[str, Callable[[Shot], Any], Callable[[Any], str], str], ...] = (
        (
            "aperture",
            lambda shot: shot.aperture,
            lambda value: f"f/{value:g}",
            "vignetting and sharpness change with the aperture: keep it fixed (mode M)",
        ),
        (
            "iso",
            lambda shot: shot.iso,
            lambda value: f"ISO {value:g}",
            "switch auto ISO off: noise and exposure ratios change with it",
        ),
    )
    return [
        finding
        for kind, value_of, text, remedy in asked
        for finding in mixed_shots(brackets, kind, "warning", value_of, text, remedy)
    ]


def _judged(qualities: Sequence[Quality]) -> list[Finding]:
    """Findings from the figures of the views."""
    findings = []

    def add(kind: str, severity: str, wrong: list[Quality], message: str, remedy: str) -> None:
        if wrong:
            views = tuple(quality.view for quality in wrong)
            findings.append(Finding(kind, severity, f"{views_in_words(views)}: {message}", remedy, views))

    for kind, figure, limit, message, remedy in (
        (
            "clipped",
            lambda q: q.clipped,
            CLIPPED_SHARE,
            "the shortest exposure is clipped in up to {:.0%} of the pixels",
            "add shorter exposures: what is clipped in all of them is only known to be brighter than that",
        ),
        (
            "noise",
            lambda q: q.noisy,
            NOISY_SHARE,
            "the longest exposure is below its noise in up to {:.0%} of the pixels",
            "add longer exposures, or light the room",
        ),
        (
            "moved",
            lambda q: q.moved,
            MOVED_SHARE,
            "something moved between the exposures in up to {:.1%} of the image",
            "nobody and nothing may move; what moved is masked",
        ),
    ):
        wrong = [q for q in qualities if figure(q) > limit]
        add(kind, "warning", wrong, message.format(max(map(figure, wrong), default=0)), remedy)
    if len(qualities) > 2:
        usual = float(np.median([q.sharpness for q in qualities]))
        blurred = [q for q in qualities if q.sharpness < BLURRED * usual]
        add(
            "blurred",
            "warning",
            blurred,
            "less sharp than the others",
            "photograph again: tripod, remote release, focus",
        )
    findings += [*_dark(qualities), *_off_ratios(qualities)]
    balances = {q.view: q.white_balance for q in qualities if q.white_balance is not None}
    if balances:
        usual = np.median(list(balances.values()), axis=0)
        odd = tuple(view for view, gains in balances.items() if np.abs(np.array(gains) / usual - 1).max() > 0.02)
        if odd:
            findings.append(
                Finding(
                    "white-balance",
                    "note",
                    f"mixed white balance: {views_in_words(odd)} differ from the rest",
                    "one white balance is used for all views of a capture; set it by hand in the camera",
                    odd,
                )
            )
    return findings


def _dark(qualities: Sequence[Quality]) -> list[Finding]:
    """Exposures that gathered next to nothing of the light that the others of their view saw."""
    return [
        Finding(
            "dark",
            "error",
            f"view {quality.view}: {frame.file} gathered {max(frame.light, 0):.1%} of the light that the other "
            "exposures tell",
            "was the lens cap on, or something before the lens? Remove the file, or photograph the view again",
            (quality.view,),
        )
        for quality in qualities
        for frame in quality.frames
        if frame.light is not None and frame.light < DARK
    ]


def _off_ratios(qualities: Sequence[Quality]) -> list[Finding]:
    """Exposures that gathered more or less light than stated, one finding for each shutter time and ratio."""
    off: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for quality in qualities:
        for frame in quality.frames:
            if frame.measured is None or frame.ratio is None:
                continue
            if abs(frame.measured / frame.ratio - 1) > RATIO_TOLERANCE:
                key = shutter_text(frame.shutter), f"1/{frame.ratio:.4g}"
                off.setdefault(key, []).append((quality.view, frame.measured))
    findings = []
    for (shutter, stated), seen in off.items():
        views = tuple(view for view, _ in seen)
        measured = f"1/{np.median([ratio for _, ratio in seen]):.4g}"
        findings.append(
            Finding(
                "ratio",
                "warning",
                f"{views_in_words(views)}: {shutter} gathered {measured} of the next longer exposure's light, "
                f"not {stated}",
                "set capture.times to measured, unless the light changed meanwhile",
                views,
            )
        )
    return findings


def calibration_notes(capture: Capture) -> list[Finding]:
    """What will not be known of the camera: missing calibration frames, and a lens that lensfun does not know."""
    if capture.kind != "raw" or (capture.folder / "calibration.json").is_file():
        return []
    frames = calibration_frames(capture.folder)
    board = "checkerboard" in frames or "charuco" in frames
    there = {"board": board, **{kind: kind in frames for kind in ("flat", "dark", "white")}}
    missing = [kind for kind, found in there.items() if not found]
    findings = []
    if missing:
        message = f"no calibration frames of: {', '.join(missing)}"
        findings.append(
            Finding("calibration", "note", message, "photograph them while you are here (docs/stages/capture.md)")
        )
    shot = capture.usual_shot
    # Size and distance do not decide whether a lens is known.
    if not (board and "flat" in frames) and lensfun.find_lens(shot, 6000, 4000, 2.5) is None:
        message = f"lensfun does not know the lens {shot.lens or 'without a name'} on {shot.camera or 'this camera'}"
        findings.append(Finding("lens", "note", message, "photograph a board and an even surface"))
    return findings


def calibration_faults(capture: Capture, settings: CaptureSettings) -> list[Finding]:
    """What is wrong with the calibration frames, found by calibrating."""
    if capture.kind == "merged":
        return []
    try:
        found = calibrate(capture, settings)
    except FiptError as error:
        return [Finding("calibration", "error", error.message, error.remedy)]
    return [finding for finding in uncalibrated(found) if finding.kind != "uncalibrated"]


def undeveloped(facts: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """A finding for every view that development has rejected."""
    return [
        Finding(
            "rejected",
            "error",
            f"view {view}: {known['rejected']}",
            "see the other findings, or take it again",
            (view,),
        )
        for view, known in facts.items()
        if "rejected" in known
    ]


def uncalibrated(calibration: Calibration) -> list[Finding]:
    """What is not known of the camera; a reprojection error that is too large."""
    found = [
        Finding("uncalibrated", "note", sentence, "photograph the frames that are missing (docs/stages/capture.md)")
        for sentence in calibration.absent
    ]
    error = calibration.figures.get("board", {}).get("rms")
    if error is not None and error > REPROJECTION:
        found.append(
            Finding(
                "reprojection",
                "warning",
                f"the board's corners are off by {error:.2f} pixels (rms) after calibration",
                "photograph a flat board, sharp, in all corners of the frame",
            )
        )
    return found
