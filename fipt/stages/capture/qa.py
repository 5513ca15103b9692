"""The report of a developed capture, qa.json: figures of every view, findings, the exposure that all views share."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.text import MALFORMED
from fipt.stages.capture.brackets import Capture
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.copies import copied_views
from fipt.stages.capture.findings import check, uncalibrated, undeveloped
from fipt.stages.capture.quality import BracketFrame, Quality

MIDDLE_GREY = 0.2
"""Luminance to which the median of a capture is brought."""


def read_facts(folder: Path, capture: Capture) -> dict[str, dict[str, Any]]:
    """View -> what ``fipt develop`` wrote about it, of the views that it was asked for."""
    facts = {}
    for bracket in capture.brackets:
        path = folder / f"{bracket.view}.json"
        if not path.is_file():
            continue
        try:
            facts[bracket.view] = dict(json.loads(path.read_text(encoding="utf-8")))
        except MALFORMED as error:
            raise FiptError(f"{path} does not hold the facts of a view ({error})", "develop the view again") from error
    if not facts:
        raise FiptError(f"{folder} must hold developed views of {capture.folder}; it holds none", "run fipt develop")
    return facts


def quality_of(facts: Mapping[str, Any]) -> Quality:
    """Figures of a developed view."""
    exposures, ratios = facts["exposures"], facts["ratios"]
    first = exposures[0]["exposure"] if exposures else 1.0
    balance = facts.get("camera_white_balance")
    return Quality(
        view=facts["view"],
        frames=tuple(
            BracketFrame(
                entry["file"],
                entry["shutter"],
                math.log2(entry["exposure"] / first),
                ratio and ratio["stated"],
                ratio and ratio["measured"],
            )
            for entry, ratio in zip(exposures, (None, *ratios, *[None] * len(exposures)), strict=False)
        ),
        clipped=float(exposures[-1]["clipped"]) if exposures else float(facts["shares"]["saturated"]),
        noisy=float(facts["shares"]["noisy"]),
        dynamic_range=float(facts.get("measurable_stops") or facts["scene_stops"]),
        sharpness=float(facts["sharpness"]),
        moved=float(facts["shares"]["moved"]),
        white_balance=None if balance is None else tuple(balance),
    )


def exposure_scale(capture: Capture, images: Iterable[np.ndarray]) -> dict[str, Any]:
    """Factor that brings a capture's radiance to the dataset's unit, and where it is from.

    A simulated capture says what its unit is, so that it can be compared with its truth; otherwise the median luminance
    of all pixels with weight becomes 0.2.
    """
    truth = capture.folder / "truth" / "camera.json"
    if truth.is_file():
        scale = float(json.loads(truth.read_text(encoding="utf-8"))["radiance_of_full_second"])
        return {"scale": scale, "from": "as the simulated camera states"}
    luminance = np.concatenate([np.zeros(0, np.float32), *images])
    middle = float(np.median(luminance)) if len(luminance) else 0.0
    if not (math.isfinite(middle) and middle > 0):
        raise FiptError("no developed view has a lit pixel with weight", "see the findings of fipt check-capture")
    return {"scale": MIDDLE_GREY / middle, "from": f"which brings the median luminance to {MIDDLE_GREY}"}


def luminances(folder: Path, views: Iterable[str]) -> Iterator[np.ndarray]:
    """About ten thousand luminances (n,) of each developed view, of pixels with weight."""
    for view in views:
        channels = read_exr(folder / "hdr" / f"{view}.exr", required=("R", "G", "B"))
        red, green, blue = (weight * channels[letter] for weight, letter in zip(LUMINANCE, "RGB", strict=True))
        total = red + green + blue
        usable = total[channels["valid.Y"] > 0.5] if "valid.Y" in channels else total.ravel()
        yield usable[:: max(len(usable) // 10_000, 1)]


def report(capture: Capture, folder: Path, calibration: Calibration) -> dict[str, Any]:
    """Content of capture/qa.json, of the views developed in ``folder``."""
    facts = read_facts(folder, capture)
    qualities = [quality_of(known) for known in facts.values() if "rejected" not in known]
    refused = undeveloped(facts)
    copied = copied_views({view: known.get("images", {}) for view, known in facts.items()})
    findings = check(capture, [*refused, *uncalibrated(calibration), *copied], qualities)
    rejected_views = {view: str(known["rejected"]) for view, known in facts.items() if "rejected" in known}
    if len(rejected_views) == len(facts):
        raise FiptError(f"all views of {capture.folder} are rejected: {refused[0].message}", "run fipt check-capture")
    views = {
        view: {"accepted": False, "reason": rejected_views[view]} if view in rejected_views else {"accepted": True}
        for view in facts
    }
    for quality in qualities:
        figures = asdict(quality)
        views[figures.pop("view")] |= figures
    developed = [view for view in views if view not in rejected_views]
    return {
        "folder": capture.folder.name,
        "kind": capture.kind,
        "exposure": exposure_scale(capture, luminances(folder, developed)),
        "views": views,
        "findings": [asdict(finding) for finding in findings],
        "calibration": {
            "sources": calibration.sources,
            "absent": calibration.absent,
            "figures": calibration.figures,
            "vignetting": None if calibration.vignetting is None else calibration.vignetting.coefficients,
        },
    }
