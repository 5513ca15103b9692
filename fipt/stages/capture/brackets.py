"""Which photographs of a folder belong to one view, and what is wrong with them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import natural
from fipt.formats.images import is_deep
from fipt.stages.capture.exposures import SAME_STOPS, exposure, shutter_text, stops
from fipt.stages.capture.folder import others, photographs
from fipt.stages.capture.raw import Shot, read_shot
from fipt.stages.capture.table import TABLE, read_table

_NEARLY_ALL = 0.7
"""Share of the views that must have the usual exposures for another one to be told: cameras may meter each view."""

_OF_RESPONSE = 3
"""Brackets from which the response of JPEG and PNG is found; it is the same for all."""

_PAUSE = (2.0, 30.0)
"""Seconds between two shots that are never, and always, a pause between brackets."""


@dataclass(frozen=True)
class Finding:
    """Something wrong with a capture.

    Attributes
    ----------
    kind
        Short name, for tests and tables: ``doubled``, ``missing``, ...
    severity
        ``error``: the views cannot be made; ``warning``: they can, and are worse for it; ``note``.
    message, remedy
        What was found, and what to do about it; one line each.
    views
        Views concerned.
    """

    kind: str
    severity: str
    message: str
    remedy: str
    views: tuple[str, ...] = ()


@dataclass(frozen=True)
class Bracket:
    """The photographs of one view.

    Attributes
    ----------
    view
        Its name: of the table, else of the first photograph.
    kind
        ``raw``, ``ldr`` (JPEG, PNG) or ``merged`` (one EXR or HDR file).
    shots
        Longest exposure first.
    """

    view: str
    kind: str
    shots: tuple[Shot, ...]


@dataclass(frozen=True)
class Capture:
    """A capture folder: its brackets in order of time, and what is wrong with them."""

    folder: Path
    brackets: tuple[Bracket, ...]
    findings: tuple[Finding, ...]

    @property
    def kind(self) -> str:
        """``raw``, ``ldr`` or ``merged``; a folder holds one kind."""
        return self.brackets[0].kind

    @property
    def usable(self) -> tuple[Bracket, ...]:
        """The brackets of the views with which nothing of severity ``error`` was found; all where there is none."""
        bad = {view for finding in self.findings if finding.severity == "error" for view in finding.views}
        return tuple(bracket for bracket in self.brackets if bracket.view not in bad) or self.brackets

    @property
    def of_response(self) -> tuple[Bracket, ...]:
        """The first brackets of several exposures: they tell the response of JPEG and PNG."""
        return tuple(bracket for bracket in self.usable if len(bracket.shots) > 1)[:_OF_RESPONSE]

    @property
    def telling(self) -> tuple[Bracket, ...]:
        """The brackets that tell the camera: the first that can be used; of JPEG and PNG also those of its response."""
        return (self.usable[0], *(self.of_response if self.kind == "ldr" else ()))

    @property
    def usual_shot(self) -> Shot:
        """The longest exposure of the first view that can be used: of the camera, lens and zoom of most."""
        return self.usable[0].shots[0]

    def bracket(self, view: str) -> Bracket:
        """The bracket of a view.

        Raises
        ------
        FiptError
            If there is no such view, or something of severity ``error`` was found with it.
        """
        for finding in self.findings:
            if finding.severity == "error" and view in finding.views:
                raise FiptError(finding.message, finding.remedy)
        for bracket in self.brackets:
            if bracket.view == view:
                return bracket
        raise FiptError(
            f"{self.folder} holds no view {view!r}", f"its views: {', '.join(b.view for b in self.brackets)}"
        )


def read_capture(folder: str | Path, frames: int = 0) -> Capture:
    """Group the photographs of a folder (not of its subfolders) into brackets.

    Parameters
    ----------
    folder
        The capture folder. Its table ``captures.tsv`` (tab-separated; columns view, file and, where EXIF is to be
        overridden, shutter in seconds or as 1/60, aperture, iso) says what belongs together; without one, exposures
        and capture times do.
    frames
        Exposures of a bracket; 0 = find out.

    Raises
    ------
    FiptError
        If the folder is missing or holds no photographs, or the table is wrong. What is wrong with single
        photographs stands in the findings.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FiptError(f"the capture folder is missing: {folder}", "check the path")
    table = folder / TABLE
    if table.exists():
        (kind, views), findings = read_table(table), []
    else:
        kind, views, findings = _grouped(folder, frames)
    if not views and findings:
        raise FiptError(findings[0].message, findings[0].remedy)
    brackets = tuple(
        Bracket(view, kind, tuple(sorted(shots, key=lambda shot: -exposure(shot)) if kind != "merged" else shots))
        for view, shots in views.items()
    )
    more = [] if kind == "merged" else [*judge(brackets), *(_deep(brackets) if kind == "ldr" else ())]
    return Capture(folder, brackets, (*findings, *more))


def _deep(brackets: Sequence[Bracket]) -> list[Finding]:
    """Say that of PNG files of 16 bits the upper 8 are used: the response of a camera is found for 256 values."""
    deep = [bracket.view for bracket in brackets if any(is_deep(shot.path) for shot in bracket.shots)]
    if not deep:
        return []
    message = f"the PNG files of {len(deep)} views have 16 bits, of which 8 are used; dark places lose most"
    return [Finding("deep", "warning", message, "give the RAW files, or linear radiance as EXR", tuple(deep))]


def group(shots: Sequence[Shot], frames: int = 0) -> list[tuple[Shot, ...]]:
    """Group shots into brackets, each in order of time, whatever the order given.

    Shots are put in order of time and cut at pauses: idle times between shots that are four times longer than usual.
    What lies between two pauses is one bracket, or several of them shot without a pause: every exposure occurs once in
    a bracket.

    Parameters
    ----------
    shots
        With shutter times.
    frames
        Exposures of a bracket; 0 = find out.
    """
    timed = all(shot.time is not None for shot in shots)  # one without a time would come first, and shift all others
    ordered = sorted(shots, key=lambda shot: (shot.time if timed else 0.0, natural(shot.path.name)))
    runs = _between_pauses(ordered)
    frames = frames or _usual_size(runs)
    return [bracket for run in runs for bracket in _split(run, frames)]


def judge(brackets: Sequence[Bracket]) -> list[Finding]:
    """Find exposures that occur twice or are missing, and frames of another camera, lens, zoom or orientation."""
    findings: list[Finding] = []
    usual = _usual_exposures(brackets)
    for bracket in brackets:
        view, shots = bracket.view, bracket.shots
        for a, b in pairwise(shots):
            if abs(stops(a) - stops(b)) < SAME_STOPS:
                findings.append(
                    Finding(
                        "doubled",
                        "error",
                        f"view {view}: {a.path.name} and {b.path.name} have the same exposure "
                        f"({shutter_text(a.seconds)})",
                        "remove one of them, or list the files of each view in captures.tsv",
                        (view,),
                    )
                )
        if len(shots) < len(usual):
            there = [stops(shot) for shot in shots]
            absent = [shot for shot in usual if all(abs(stops(shot) - s) >= SAME_STOPS for s in there)]
            which = ", ".join(shutter_text(shot.seconds) for shot in absent[: len(usual) - len(shots)])
            findings.append(
                Finding(
                    "missing",
                    "warning",
                    f"view {view} has {len(shots)} exposures where the other views have {len(usual)}: {which} missing",
                    "copy the file from the card again, or go on: the view has less range",
                    (view,),
                )
            )
        turned = {shot.orientation for shot in shots}
        if len(turned) > 1:
            odd = _odd_one(shots, "orientation")
            findings.append(
                Finding(
                    "orientation",
                    "error",
                    f"view {view}: the frames of a bracket must have one orientation; {odd.path.name} differs",
                    "remove it, or list the files of each view in captures.tsv",
                    (view,),
                )
            )
    findings += _shifted(brackets, usual)
    cameras = Counter((shot.camera, shot.serial) for bracket in brackets for shot in bracket.shots)
    if len(cameras) > 1:
        main = cameras.most_common(1)[0][0]
        odd = [(b.view, s) for b in brackets for s in b.shots if (s.camera, s.serial) != main]
        findings.append(
            Finding(
                "camera",
                "error",
                f"the frames of a capture must be of one camera; {odd[0][1].path.name} and {len(odd) - 1} others are "
                f"of {_named(odd[0][1])}, the rest of {' '.join(filter(None, main)) or 'an unnamed one'}",
                "put the photographs of each camera into a folder of their own",
                tuple(dict.fromkeys(view for view, _ in odd)),
            )
        )
    return [*findings, *_of_one_lens(brackets)]


def _of_one_lens(brackets: Sequence[Bracket]) -> list[Finding]:
    """Tell photographs with another focal length or lens than most: one calibration serves all of a capture."""

    def focal_length(shot: Shot) -> float | None:
        return shot.focal_length and round(shot.focal_length, 1)

    asked: tuple[tuple[str, Callable[[Shot], Any], Callable[[Any], str], str], ...] = (
        (
            "focal-length",
            focal_length,
            lambda value: f"{value:g} mm",
            "a capture has one camera: photograph these views again, or in a folder of their own",
        ),
        ("lens", lambda shot: shot.lens, str, "a capture has one lens: put these views into another folder"),
    )
    return [
        finding
        for kind, value_of, text, remedy in asked
        for finding in mixed_shots(brackets, kind, "error", value_of, text, remedy)
    ]


def mixed_shots(
    brackets: Sequence[Bracket],
    kind: str,
    severity: str,
    value_of: Callable[[Shot], Any],
    text: Callable[[Any], str],
    remedy: str,
) -> list[Finding]:
    """Tell, in one finding, photographs that have another value of ``kind`` than most; None is no value."""
    known = [(bracket.view, shot) for bracket in brackets for shot in bracket.shots if value_of(shot) is not None]
    usual = Counter(value_of(shot) for _, shot in known).most_common(1)
    odd = [(view, shot) for view, shot in known if value_of(shot) != usual[0][0]]
    if not odd:
        return []
    shots, views = [shot for _, shot in odd], tuple(dict.fromkeys(view for view, _ in odd))
    listed = ", ".join(dict.fromkeys(text(value_of(shot)) for shot in shots))
    more = f" and {len(shots) - 3} more" if len(shots) > 3 else ""
    files = ", ".join(shot.path.name for shot in shots[:3]) + more
    name = kind.replace("-", " ").replace("iso", "ISO")
    message = f"mixed {name}: most photographs have {text(usual[0][0])}, but {files} {listed} ({views_in_words(views)})"
    return [Finding(kind, severity, message, remedy, views)]


def views_in_words(views: Sequence[str]) -> str:
    """Names of views, five at most."""
    more = f" and {len(views) - 5} more" if len(views) > 5 else ""
    return f"view{'s' if len(views) > 1 else ''} {', '.join(views[:5])}{more}"


def _shifted(brackets: Sequence[Bracket], usual: Sequence[Shot]) -> list[Finding]:
    """Tell views whose files state exposures that nearly all others have not."""
    return [
        Finding(
            "shifted",
            "warning",
            f"view {bracket.view}: its files state exposures {abs(shift):.1f} EV "
            f"{'longer' if shift > 0 else 'shorter'} than those of the other views",
            "good if you meant it; if not, its radiance is off by as much: state the true times in captures.tsv",
            (bracket.view,),
        )
        for bracket in brackets
        if (shift := _shift(bracket.shots, usual, brackets))
    ]


def _shift(shots: Sequence[Shot], usual: Sequence[Shot], brackets: Sequence[Bracket]) -> float:
    """EV by which all exposures of a bracket differ from those that nearly all others have; 0 where none are usual."""

    def levels(own: Sequence[Shot]) -> np.ndarray:
        return np.array([stops(shot) for shot in own])

    def same(own: Sequence[Shot]) -> bool:
        return len(own) == len(usual) and bool((np.abs(levels(own) - levels(usual)) < SAME_STOPS).all())

    if len(shots) != len(usual) or same(shots):
        return 0.0
    if sum(same(bracket.shots) for bracket in brackets) < _NEARLY_ALL * len(brackets):
        return 0.0
    off = levels(shots) - levels(usual)
    return float(np.median(off)) if np.ptp(off) < 2 * SAME_STOPS else 0.0


def _named(shot: Shot) -> str:
    return " ".join(filter(None, (shot.camera, shot.serial))) or "an unnamed one"


def _odd_one(shots: Sequence[Shot], field: str) -> Shot:
    usual = Counter(getattr(shot, field) for shot in shots).most_common(1)[0][0]
    return next(shot for shot in shots if getattr(shot, field) != usual)


def _usual_exposures(brackets: Sequence[Bracket]) -> tuple[Shot, ...]:
    """Shots of a bracket as most views have it: the usual number of frames, then the usual exposures."""
    sizes = Counter(len(bracket.shots) for bracket in brackets)
    size = max(sizes, key=lambda n: (sizes[n], n))
    complete = [bracket for bracket in brackets if len(bracket.shots) == size]
    keys = [tuple(round(stops(shot), 1) for shot in bracket.shots) for bracket in complete]
    return complete[keys.index(Counter(keys).most_common(1)[0][0])].shots


def _between_pauses(ordered: list[Shot]) -> list[list[Shot]]:
    if len(ordered) < 2 or any(shot.time is None for shot in ordered):
        return [ordered]
    time = np.array([shot.time for shot in ordered])
    idle = np.diff(time) - np.array([shot.shutter for shot in ordered[:-1]])
    pause = np.clip(4 * np.median(idle), *_PAUSE)
    cuts = np.flatnonzero(idle > pause) + 1
    return [list(run) for run in np.split(np.array(ordered, object), cuts)]


def _usual_size(runs: list[list[Shot]]) -> int:
    """Length of most runs, if no exposure repeats in them: a bracket; 0 where runs tell nothing."""
    lengths = Counter(len(run) for run in runs if not _repeats(run))
    length, count = lengths.most_common(1)[0] if lengths else (0, 0)
    return length if len(runs) > 1 and 2 * count > len(runs) else 0


def _split(run: list[Shot], frames: int) -> list[tuple[Shot, ...]]:
    """Cut a run of shots without a pause into brackets."""
    levels = [stops(shot) for shot in run]
    distinct = 1 + int((np.diff(np.sort(levels)) >= SAME_STOPS).sum())
    size = frames or distinct
    chunks = [tuple(run[i : i + size]) for i in range(0, len(run), size)]
    if len(run) % size == 0 and not any(map(_repeats, chunks)):
        return chunks
    pieces: list[list[Shot]] = [[]]
    for shot in run:
        if _repeats((*pieces[-1], shot)):
            pieces.append([])
        pieces[-1].append(shot)
    # Short pieces, or none that is complete: a frame was taken twice. It is one bracket, and `judge` names the frame.
    sizes = [len(piece) for piece in pieces]
    if len(run) < 2 * size and (min(sizes) <= size / 2 or max(sizes) < size):
        return [tuple(run)]
    return [tuple(piece) for piece in pieces]


def _repeats(shots: Sequence[Shot]) -> bool:
    levels = np.sort([stops(shot) for shot in shots])
    return bool((np.diff(levels) < SAME_STOPS).any())


def _grouped(folder: Path, frames: int) -> tuple[str, dict[str, tuple[Shot, ...]], list[Finding]]:
    kind, files = photographs(folder)
    findings = _left_out(folder, files)
    if kind == "merged":
        merged: dict[str, tuple[Shot, ...]] = {}
        for path in files:
            merged[_view_name(path.stem, merged)] = (Shot(path),)
        return kind, merged, findings
    shots = []
    for path in files:
        try:
            shot = read_shot(path)
        except FiptError as error:
            findings.append(Finding("unreadable", "error", error.message, error.remedy))
            continue
        if shot.shutter:
            shots.append(shot)
        else:
            findings.append(
                Finding(
                    "exposure",
                    "error",
                    f"{path} states no exposure time",
                    "give it in captures.tsv (columns view, file, shutter)",
                )
            )
    views: dict[str, tuple[Shot, ...]] = {}
    for bracket in group(shots, frames) if shots else ():
        views[_view_name(bracket[0].path.stem, views)] = bracket
    return kind, views, findings


def _left_out(folder: Path, read: Sequence[Path]) -> list[Finding]:
    """Photographs of another kind than those that are read: JPEGs beside RAW files, of the same shots and of others."""
    paired, lost = others(folder, read)
    findings = []
    if paired:
        message = f"{len(paired)} files are beside photographs of the same names, which are read instead"
        findings.append(Finding("paired", "note", message, "nothing is to be done"))
    if lost:
        message = f"{len(lost)} photographs are of another kind than {read[0].name} and are not read, such as {lost[0]}"
        remedy = "copy what is missing from the card again, or put them into a folder of their own"
        findings.append(Finding("left-out", "warning", message, remedy))
    return findings


def _view_name(stem: str, taken: Collection[str]) -> str:
    """A view's name from a file's: what may not stand in a name becomes ``_``; one that is taken gets a number."""
    name = re.sub(r"[^A-Za-z0-9_.-]|(?<=\.)\.", "_", stem).lstrip("_.-") or "view"
    numbered = (f"{name}_{number}" for number in count(len(taken)))
    return name if name not in taken else next(text for text in numbered if text not in taken)
