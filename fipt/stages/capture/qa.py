"""What is wrong with a capture, and what to do about it: figures of every view, findings with a severity.

Everything is measured on the raw values, so that it can be known in the room, before anything is developed.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.progress import progress
from fipt.stages.capture import lensfun
from fipt.stages.capture.brackets import Bracket, Capture, Finding
from fipt.stages.capture.calibrate import calibration_frames
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.exposures import RATIO_TOLERANCE, exposure, measured_ratio, shutter_text, stops
from fipt.stages.capture.merge import assumed_noise, measured_noise
from fipt.stages.capture.raw import RawFrame, Shot, read_raw

SEVERITIES = ("error", "warning", "note")
"""Of findings, worst first. With an error a view, or the capture, cannot be used."""

FULL = 0.99
"""Share of the range from which a raw value counts as clipped."""

CLIPPED_SHARE = 0.01
"""Share of pixels that may be clipped in the shortest exposure: lamps; more is a window or a wrong exposure."""

NOISY_SHARE = 0.1
"""Share of pixels that may be darker than the read noise in the longest exposure."""

MOVED_SHARE = 0.005
"""Share of the picture that may differ between exposures."""

REPROJECTION = 0.5
"""Root mean square distance of board corners after calibration that is still good, pixels."""

MIDDLE_GREY = 0.2
"""Luminance to which the median of a capture is brought."""

BLURRED = 0.4
"""A view with less than this share of the capture's usual sharpness is blurred."""

_DIFFERENT = 0.1
"""Relative difference of two exposures of a block from which something has moved there."""
_BLOCK = 8
"""Side of such a block, cells of the mosaic."""
_LIT = 0.03
"""Share of the range above which a block is compared."""
_NEAR, _FAR = 1, 8
"""Cells over which a sharp edge has risen, and over which any has."""


@dataclass(frozen=True)
class Frame:
    """One exposure of a view.

    Attributes
    ----------
    file
        Name of the file.
    shutter
        Seconds as the camera states them.
    stops
        Exposure relative to the longest one of the view, stops (0, then negative).
    ratio, measured
        Exposure of the next longer frame over this one: as stated, and measured from pixels that both see well; None
        for the longest, and where too few pixels tell.
    """

    file: str
    shutter: float
    stops: float
    ratio: float | None
    measured: float | None


@dataclass(frozen=True)
class Quality:
    """Figures of a view.

    Attributes
    ----------
    view
        Its name.
    frames
        Exposures, longest first.
    clipped
        Share of pixels clipped in the shortest exposure: their radiance is only a lower bound.
    noisy
        Share of pixels darker than the read noise in the longest exposure.
    dynamic_range
        From the noise of the longest to saturation of the shortest exposure, stops.
    sharpness
        Share of the strongest edges' height within one cell of the mosaic, about 1 sharp, 0.2 badly blurred; of
        developed views, their steepness. Good for comparing views of a capture with each other.
    moved
        Share of the picture where exposures disagree.
    white_balance
        Gains of red, green and blue as the camera has them; None where it has none.
    """

    view: str
    frames: tuple[Frame, ...]
    clipped: float
    noisy: float
    dynamic_range: float
    sharpness: float
    moved: float
    white_balance: tuple[float, float, float] | None


def measure(bracket: Bracket, frames: Sequence[RawFrame]) -> Quality:
    """Measure a view.

    Parameters
    ----------
    bracket
        Its photographs, longest exposure first.
    frames
        Their mosaics, in the same order.

    Raises
    ------
    FiptError
        If the frames are of different size.
    """
    check_sizes(bracket.view, frames)
    exposures = [exposure(shot) for shot in bracket.shots]
    ratios = [a / b for a, b in pairwise(exposures)]
    measured = [
        measured_ratio(longer, shorter, longer.black, ratio)
        for longer, shorter, ratio in zip(frames, frames[1:], ratios, strict=False)
    ]
    greens, full = [_green(frame) for frame in frames], [_clipped(frame) for frame in frames]
    sensor = measured_noise(frames, exposures, frames[0].black) or assumed_noise(frames[0], frames[0].black)
    noise = sensor.read / float(np.mean(frames[0].range))
    best = max(greens, key=lambda green: float(((green > 0.05) & (green < 0.9)).mean()))
    return Quality(
        view=bracket.view,
        frames=tuple(
            Frame(shot.path.name, shot.shutter, math.log2(value / exposures[0]), ratio, found)
            for shot, value, ratio, found in zip(
                bracket.shots, exposures, (None, *ratios), (None, *measured), strict=True
            )
        ),
        clipped=float(full[-1].mean()),
        noisy=float((greens[0] < noise).mean()),
        dynamic_range=math.log2(exposures[0] / exposures[-1] / noise),
        sharpness=_sharpness(best),
        moved=_moved(greens, full, measured),
        white_balance=None if frames[0].white_balance is None else tuple(map(float, frames[0].white_balance)),
    )


def check_sizes(view: str, frames: Sequence[RawFrame]) -> None:
    """Raise FiptError if the frames of a view are of different size or mosaic."""
    usual = Counter((frame.shape, frame.pattern.tobytes()) for frame in frames).most_common(1)[0][0]
    for frame in frames:
        if (frame.shape, frame.pattern.tobytes()) != usual:
            (rows, columns), (height, width) = frame.shape, usual[0]
            raise FiptError(
                f"view {view}: the frames of a bracket must have one size and mosaic; {frame.shot.path.name} is "
                f"{columns}x{rows}, the others {width}x{height}",
                "remove it, or photograph the view again",
            )


def _planes(frame: RawFrame, color: int) -> list[np.ndarray]:
    """(H/2, W/2) raw values of each position of the cell with this colour (both greens count as 1)."""
    rows, columns = (size // 2 * 2 for size in frame.shape)
    return [
        frame.mosaic[i:rows:2, j:columns:2]
        for i in range(2)
        for j in range(2)
        if frame.pattern[i, j] == color or (color == 1 and frame.pattern[i, j] == 3)
    ]


def _green(frame: RawFrame) -> np.ndarray:
    """(H/2, W/2) float32 mean of the two greens of each cell, as a share of the range."""
    greens = _planes(frame, 1)
    black = np.mean([frame.black[1], frame.black[3]])
    span = np.mean([frame.range[1], frame.range[3]])
    total = greens[0].astype(np.float32)
    for plane in greens[1:]:
        total += plane
    return (total / len(greens) - np.float32(black)) / np.float32(span)


def _clipped(frame: RawFrame) -> np.ndarray:
    """(H/2, W/2) bool: cells of which a pixel is clipped."""
    rows, columns = (size // 2 * 2 for size in frame.shape)
    found = np.zeros((rows // 2, columns // 2), bool)
    for i in range(2):
        for j in range(2):
            color = frame.pattern[i, j]
            limit = frame.black[color] + FULL * frame.range[color]
            found |= frame.mosaic[i:rows:2, j:columns:2] >= limit
    return found


def _sharpness(green: np.ndarray) -> float:
    """Height of the strongest edges within `_NEAR` cells over that within `_FAR` cells."""
    # Square root: about the same noise everywhere, and a lamp's edge does not decide alone.
    picture = np.sqrt(np.clip(green, 0.0, 1.0))
    steps = []
    for distance in (_NEAR, _FAR):
        across = np.abs(picture[:, distance:] - picture[:, :-distance])
        down = np.abs(picture[distance:] - picture[:-distance])
        steps.append(max(np.quantile(across, 0.999), np.quantile(down, 0.999)))
    return float(steps[0] / max(steps[1], 1e-6))


def _moved(greens: Sequence[np.ndarray], full: Sequence[np.ndarray], ratios: Sequence[float | None]) -> float:
    """Share of blocks whose exposures disagree, among all blocks.

    ``full`` are the clipped cells, ``ratios`` measured: stated ones may be wrong for the whole picture.
    """
    rows, columns = (size // _BLOCK for size in greens[0].shape)
    if rows == 0 or columns == 0:
        return 0.0

    def blocks(cells: np.ndarray) -> np.ndarray:
        cells = cells[: rows * _BLOCK, : columns * _BLOCK]
        return cells.reshape(rows, _BLOCK, columns, _BLOCK)

    means = [blocks(green).mean(axis=(1, 3)) for green in greens]
    whole = [~blocks(cells).any(axis=(1, 3)) for cells in full]
    found = np.zeros((rows, columns), bool)
    for k, ratio in enumerate(ratios):
        if ratio is None:
            continue
        expected, seen = means[k] / ratio, means[k + 1]
        brighter = np.maximum(expected, seen)
        found |= whole[k] & whole[k + 1] & (brighter > _LIT) & (np.abs(expected - seen) > _DIFFERENT * brighter)
    return float(found.mean())


# --- findings -----------------------------------------------------------------------------------


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
    """What should be the same in all photographs: aperture, ISO, focal length, lens."""
    asked = (
        (
            "aperture",
            "warning",
            lambda shot: shot.aperture,
            lambda value: f"f/{value:g}",
            "vignetting and sharpness change with the aperture: keep it fixed (mode M)",
        ),
        (
            "iso",
            "warning",
            lambda shot: shot.iso,
            lambda value: f"ISO {value:g}",
            "switch auto ISO off: noise and exposure ratios change with it",
        ),
        (
            "focal-length",
            "error",
            lambda shot: shot.focal_length and round(shot.focal_length, 1),
            lambda value: f"{value:g} mm",
            "a capture has one camera: photograph these views again, or in a folder of their own",
        ),
        ("lens", "error", lambda shot: shot.lens, str, "a capture has one lens: put these views into another folder"),
    )
    findings = []
    for kind, severity, value_of, text, remedy in asked:
        usual, odd = _odd_shots(brackets, value_of)
        if odd:
            shots = [shot for _, shot in odd]
            listed = ", ".join(dict.fromkeys(text(value_of(shot)) for shot in shots))
            views = tuple(dict.fromkeys(view for view, _ in odd))
            name = kind.replace("-", " ").replace("iso", "ISO")
            findings.append(
                Finding(
                    kind,
                    severity,
                    f"mixed {name}: most photographs have {text(usual)}, but {_files(shots)} {listed} "
                    f"({_views(views)})",
                    remedy,
                    views,
                )
            )
    return findings


def _odd_shots(brackets: Sequence[Bracket], value_of: Callable[[Shot], Any]) -> tuple[Any, list[tuple[str, Shot]]]:
    """The usual value, and (view, shot) of the photographs that have another one."""
    known = [(b.view, shot) for b in brackets for shot in b.shots if value_of(shot) is not None]
    if not known:
        return None, []
    usual = Counter(value_of(shot) for _, shot in known).most_common(1)[0][0]
    return usual, [(view, shot) for view, shot in known if value_of(shot) != usual]


def _files(shots: Sequence[Shot]) -> str:
    more = f" and {len(shots) - 3} more" if len(shots) > 3 else ""
    return ", ".join(shot.path.name for shot in shots[:3]) + more


def _views(views: Sequence[str]) -> str:
    more = f" and {len(views) - 5} more" if len(views) > 5 else ""
    return f"view{'s' if len(views) > 1 else ''} {', '.join(views[:5])}{more}"


def _judged(qualities: Sequence[Quality]) -> list[Finding]:
    """Findings from the figures of the views."""
    findings = []

    def add(kind: str, severity: str, wrong: list[Quality], message: str, remedy: str) -> None:
        if wrong:
            views = tuple(quality.view for quality in wrong)
            findings.append(Finding(kind, severity, f"{_views(views)}: {message}", remedy, views))

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
            "something moved between the exposures in up to {:.1%} of the picture",
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
    findings += _off_ratios(qualities)
    balances = {q.view: q.white_balance for q in qualities if q.white_balance is not None}
    if balances:
        usual = np.median(list(balances.values()), axis=0)
        odd = tuple(view for view, gains in balances.items() if np.abs(np.array(gains) / usual - 1).max() > 0.02)
        if odd:
            findings.append(
                Finding(
                    "white-balance",
                    "note",
                    f"mixed white balance: {_views(odd)} differ from the rest",
                    "one white balance is used for all views of a capture; set it by hand in the camera",
                    odd,
                )
            )
    return findings


def _off_ratios(qualities: Sequence[Quality]) -> list[Finding]:
    """Exposures that gathered more or less light than stated, one finding for each shutter time and ratio."""
    off: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for quality in qualities:
        for frame in quality.frames:
            if frame.measured is not None and abs(frame.measured / frame.ratio - 1) > RATIO_TOLERANCE:
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
                f"{_views(views)}: {shutter} gathered {measured} of the next longer exposure's light, not {stated}",
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
        findings.append(Finding("calibration", "note", message, "photograph them while you are here (docs/capture.md)"))
    shot = capture.brackets[0].shots[0]
    # Size and distance do not decide whether a lens is known.
    if not (board and "flat" in frames) and lensfun.look_up(shot, 6000, 4000, 2.5) is None:
        message = f"lensfun does not know the lens {shot.lens or 'without a name'} on {shot.camera or 'this camera'}"
        findings.append(Finding("lens", "note", message, "photograph a board and an even surface"))
    return findings


def inspect(capture: Capture, threads: int = 2) -> tuple[list[Quality], list[Finding]]:
    """Read every view and measure those of a RAW capture; what is wrong with a file becomes a finding."""

    def look(bracket: Bracket) -> Quality | Finding | None:
        try:
            if bracket.kind != "raw":
                return _not_finite(bracket) if bracket.kind == "merged" else None
            frames = [read_raw(shot.path, shot) for shot in bracket.shots]
        except FiptError as error:
            message = f"view {bracket.view}: {error.message}"
            return Finding("unreadable", "error", message, error.remedy, (bracket.view,))
        try:
            return measure(bracket, frames)
        except FiptError as error:
            return Finding("size", "error", error.message, error.remedy, (bracket.view,))

    results = []
    with progress("check", len(capture.brackets), " views") as bar, ThreadPoolExecutor(threads) as pool:
        for result in pool.map(look, capture.brackets):
            results.append(result)
            bar.advance()
    qualities = [result for result in results if isinstance(result, Quality)]
    findings = [result for result in results if isinstance(result, Finding)]
    if capture.kind != "raw":
        message = "these are no RAW files: exposure, noise, movement and sharpness are not measured"
        findings.append(Finding("not-measured", "note", message, "give RAW brackets to have them checked"))
    return qualities, findings


def _not_finite(bracket: Bracket) -> Finding | None:
    """What is wrong with the numbers of a merged view, if anything."""
    from fipt.stages.capture.develop import read_merged

    radiance, _ = read_merged(bracket.shots[0].path)
    bad = int((~np.isfinite(radiance).all(axis=-1)).sum())
    if bad == 0:
        return None
    message = f"view {bracket.view}: {bad} pixels are NaN or infinite; they get weight 0"
    return Finding("not-finite", "warning", message, "merge the view again", (bracket.view,))


# --- developed views ------------------------------------------------------------------------------


def read_facts(folder: Path, capture: Capture) -> dict[str, dict[str, Any]]:
    """View -> what ``fipt develop`` wrote about it, of the views that it was asked for."""
    facts = {}
    for bracket in capture.brackets:
        path = folder / f"{bracket.view}.json"
        if not path.is_file():
            continue
        try:
            facts[bracket.view] = dict(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, TypeError) as error:
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
            Frame(
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
        Finding("uncalibrated", "note", sentence, "photograph the frames that are missing (docs/capture.md)")
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


def exposure_scale(capture: Capture, pictures: Iterable[np.ndarray]) -> dict[str, Any]:
    """Factor that brings a capture's radiance to the dataset's unit, and where it is from.

    A simulated capture says what its unit is, so that it can be compared with its truth; otherwise the median luminance
    of all pixels with weight becomes 0.2.
    """
    truth = capture.folder / "truth" / "camera.json"
    if truth.is_file():
        scale = float(json.loads(truth.read_text(encoding="utf-8"))["radiance_of_full_second"])
        return {"scale": scale, "from": "as the simulated camera states"}
    luminance = np.concatenate([np.zeros(0, np.float32), *pictures])
    middle = float(np.median(luminance)) if len(luminance) else 0.0
    if not (math.isfinite(middle) and middle > 0):
        raise FiptError("no developed view has a lit pixel with weight", "see the findings of fipt check-capture")
    return {"scale": MIDDLE_GREY / middle, "from": f"which brings the median luminance to {MIDDLE_GREY}"}


def luminances(folder: Path, views: Iterable[str]) -> Iterator[np.ndarray]:
    """About ten thousand luminances (n,) of each developed view, of pixels with weight."""
    for view in views:
        channels = read_exr(folder / "hdr" / f"{view}.exr", required=("R", "G", "B"))
        total = sum(weight * channels[letter] for weight, letter in zip(LUMINANCE, "RGB", strict=True))
        usable = total[channels["valid.Y"] > 0.5] if "valid.Y" in channels else total.ravel()
        yield usable[:: max(len(usable) // 10_000, 1)]


def report(capture: Capture, folder: Path, calibration: Calibration) -> dict[str, Any]:
    """Content of capture/qa.json, of the views developed in ``folder``."""
    facts = read_facts(folder, capture)
    qualities = [quality_of(known) for known in facts.values() if "rejected" not in known]
    refused = undeveloped(facts)
    findings = check(capture, [*refused, *uncalibrated(calibration)], qualities)
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


def balance_text(gains: tuple[float, float, float] | None) -> str:
    """White balance for a table: gains of red and blue over green."""
    return "-" if gains is None else f"{gains[0]:.2f} {gains[2]:.2f}"


def span_text(bracket: Bracket) -> str:
    """Exposures of a bracket for a table: how many, and how many stops they span."""
    levels = [stops(shot) for shot in bracket.shots if shot.shutter]
    return f"{len(bracket.shots)}, {max(levels) - min(levels):.0f} EV" if levels else f"{len(bracket.shots)}"
