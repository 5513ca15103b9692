"""Reads every view of a capture and measures it, for the check before development."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.stages.capture.brackets import Bracket, Capture, Finding
from fipt.stages.capture.copies import check_copies, copied_views
from fipt.stages.capture.exposures import stops
from fipt.stages.capture.ldr import HIGHEST, LOWEST, check_order, read_ldr
from fipt.stages.capture.quality import Quality, measure
from fipt.stages.capture.raw import read_raw


def inspect(capture: Capture, threads: int = 2) -> tuple[list[Quality], list[Finding]]:
    """Read every view and measure those of a RAW capture; what is wrong with a file becomes a finding."""
    images: dict[str, dict[str, str | None]] = {}

    def measured(bracket: Bracket) -> Quality | Finding | None:
        try:
            frames = [read_raw(shot.path, shot) for shot in bracket.shots] if bracket.kind == "raw" else []
            pixels = [frame.mosaic for frame in frames] or _pixels(bracket)
        except FiptError as error:
            message = f"view {bracket.view}: {error.message}"
            return Finding("unreadable", "error", message, error.remedy, (bracket.view,))
        try:
            images[bracket.view] = check_copies(bracket, pixels)
            if bracket.kind == "ldr":
                check_order(bracket, pixels)
                return _useless(bracket, pixels)
            if bracket.kind == "merged":
                return _not_finite(bracket.view, pixels[0])
            return measure(bracket, frames)
        except FiptError as error:
            return Finding("bracket", "error", error.message, error.remedy, (bracket.view,))

    results = []
    with progress("check", len(capture.brackets), " views") as bar, ThreadPoolExecutor(threads) as pool:
        for result in pool.map(measured, capture.brackets):
            results.append(result)
            bar.advance()
    qualities = [result for result in results if isinstance(result, Quality)]
    findings = [result for result in results if isinstance(result, Finding)]
    findings += copied_views({bracket.view: images.get(bracket.view, {}) for bracket in capture.brackets})
    if capture.kind != "raw":
        message = "these are no RAW files: exposure, noise, movement and sharpness are not measured"
        findings.append(Finding("not-measured", "note", message, "give RAW brackets to have them checked"))
    return qualities, findings


def _pixels(bracket: Bracket) -> list[np.ndarray]:
    """Images of a bracket that is not RAW."""
    from fipt.stages.capture.develop import read_merged

    return [read_ldr(shot.path) if bracket.kind == "ldr" else read_merged(shot.path)[0] for shot in bracket.shots]


def _not_finite(view: str, radiance: np.ndarray) -> Finding | None:
    """What is wrong with the numbers of a merged view, if anything."""
    bad = int((~np.isfinite(radiance).all(axis=-1)).sum())
    if bad == 0:
        return None
    message = f"view {view}: {bad} pixels are NaN or infinite; they get weight 0"
    return Finding("not-finite", "warning", message, "merge the view again", (view,))


def _useless(bracket: Bracket, images: list[np.ndarray]) -> Finding | None:
    """What is wrong with the range or the colours of a view of JPEG or PNG files, if anything."""
    clipped, dark = (images[-1] > HIGHEST).all(axis=-1).mean(), (images[0] < LOWEST).all(axis=-1).mean()
    view, remedy = (bracket.view,), "photograph the view again, with other exposures"
    if max(clipped, dark) > 0.5:
        which = "shortest exposure is clipped" if clipped > dark else "longest exposure is black"
        message = f"view {bracket.view}: the {which} in {max(clipped, dark):.0%} of the pixels"
        return Finding("clipped" if clipped > dark else "noise", "warning", message, remedy, view)
    if all((image == image[..., :1]).all() for image in images):
        return Finding("grey", "warning", f"view {bracket.view} has no colours", "give the photographs in colour", view)
    return None


def balance_text(gains: tuple[float, float, float] | None) -> str:
    """White balance for a table: gains of red and blue over green."""
    return "-" if gains is None else f"{gains[0]:.2f} {gains[2]:.2f}"


def span_text(bracket: Bracket) -> str:
    """Exposures of a bracket for a table: how many, and how many stops they span."""
    levels = [stops(shot) for shot in bracket.shots if shot.shutter]
    return f"{len(bracket.shots)}, {max(levels) - min(levels):.0f} EV" if levels else f"{len(bracket.shots)}"
