"""All rooms of a folder of results: what the index and its table say about each, from the files that are there."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.formats.text import MALFORMED
from fipt.outcome import failures_so_far
from fipt.scene import display
from fipt.stages.report.files import read_json
from fipt.stages.report.images import embedded

log = logging.getLogger(__name__)

STATES = ("failed", "unfinished", "done")
"""Of a room, worst first."""

THUMBNAIL = 144
"""Width of a thumbnail, pixels."""


@dataclass(frozen=True)
class RoomRow:
    """A room in the index.

    Attributes
    ----------
    name, state
        Of its folder; one of `STATES`.
    why
        The job that failed and its line; empty: none did.
    log
        The log of that job, relative to the folder of results.
    figures
        Figure of the held-out views -> value.
    of_training
        Whether figures are of training views, since none is held out.
    serious, warnings
        Numbers of findings; None: nobody looked.
    finding
        The worst, in a line.
    seconds
        Stage -> wall time, summed over its jobs.
    memory
        Largest peak of a job, bytes.
    thumbnail
        Data URI; empty: there is no image.
    """

    name: str
    state: str
    why: str = ""
    log: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    of_training: bool = False
    serious: int | None = None
    warnings: int | None = None
    finding: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    memory: int = 0
    thumbnail: str = ""

    @property
    def total(self) -> float:
        """Seconds of all its jobs."""
        return sum(self.seconds.values())


@dataclass(frozen=True)
class RoomFigure:
    """A figure that rooms have: its key, label, unit, definition, and which direction is better."""

    key: str
    label: str
    unit: str
    better: str
    text: str

    def worse(self, value: float) -> float:
        """A number that is larger where the figure is worse."""
        return -value if self.better == "higher" else value


def read_rooms(folder: Path, names: Sequence[str], keys: Sequence[str]) -> tuple[list[RoomRow], list[RoomFigure]]:
    """Read every room, the worst first, and the figures that any of them has.

    Parameters
    ----------
    folder
        Of all results.
    names
        Rooms, folders in it.
    keys
        Figures that may be shown, in order.
    """
    rows, known = [], {}
    kept = _kept_thumbnails(folder)
    for name in names:
        metrics = _content(folder / name / "metrics.json")
        known |= {key: _keyed(text) for key, text in _keyed(metrics.get("definitions")).items() if key in keys}
        rows.append(_row(folder, name, metrics, keys, _keyed(kept.get(name))))
    shown = [key for key in keys if key in known and any(key in row.figures for row in rows)]
    figures = [RoomFigure(key, *(str(known[key].get(part, "")) for part in _PARTS)) for key in shown]
    return sorted(rows, key=lambda row: _badness(row, figures), reverse=True), figures


_PARTS = ("label", "unit", "better", "text")


def _badness(row: RoomRow, figures: Sequence[RoomFigure]) -> tuple[float, ...]:
    """Larger is worse: what failed, then serious findings, then warnings, then the first figure."""
    worst = [figure.worse(row.figures[figure.key]) for figure in figures if figure.key in row.figures]
    state = len(STATES) - STATES.index(row.state)
    return (state, row.serious or 0, row.warnings or 0, worst[0] if worst else float("-inf"))


def _row(folder: Path, name: str, metrics: Mapping[str, Any], keys: Sequence[str], kept: Mapping[str, Any]) -> RoomRow:
    results = folder / name
    done, failed = (results / "report.html").is_file(), failures_so_far(results)
    listed = _content(results / "findings.json").get("findings")
    found = list(map(_keyed, listed)) if isinstance(listed, list) else None
    levels = None if found is None else [str(each.get("severity")) for each in found]
    stats = [(path.stem.split(".")[0], _content(path)) for path in sorted(results.glob("stats/*.json"))]
    seconds: dict[str, float] = {}
    for stage, said in stats:
        seconds[stage] = seconds.get(stage, 0.0) + _number(said.get("wall_s"))
    held_out, training = (_judged(metrics, split, keys) for split in ("val", "train"))
    return RoomRow(
        name=name,
        state="failed" if failed else "done" if done else "unfinished",
        why=f"{failed[0].stage}: {failed[0].line}" if failed else "",
        log=failed[0].log.relative_to(folder).as_posix() if failed else "",
        figures=held_out or training,
        of_training=not held_out and bool(training),
        serious=None if levels is None else levels.count("serious"),
        warnings=None if levels is None else levels.count("warning"),
        finding=f"{found[0].get('cause', '')}" if found else "",
        seconds=seconds,
        memory=max((int(_number(said.get("peak_memory_bytes"))) for _, said in stats), default=0),
        thumbnail=_thumbnail(results, kept),
    )


def _judged(metrics: Mapping[str, Any], split: str, keys: Sequence[str]) -> dict[str, float]:
    """Figures of a split that are known."""
    found = _keyed(metrics.get(split))
    return {key: float(found[key]) for key in keys if isinstance(found.get(key), int | float)}


def _content(path: Path) -> dict[str, Any]:
    """A JSON file of keys; nothing where it is missing, or damaged, of which a warning tells."""
    if not path.exists():
        return {}
    try:
        content = read_json(path)
        if not isinstance(content, dict):
            raise FiptError(f"{path} must hold keys")
    except FiptError as error:
        log.warning("%s: the page goes without it", error.message)
        return {}
    return content


def _keyed(value: Any) -> dict[str, Any]:
    """Return a mapping; an empty one in place of anything else."""
    return value if isinstance(value, dict) else {}


def _number(value: Any) -> float:
    """Return a finite number; 0 in place of anything else."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


def _thumbnail(results: Path, kept: Mapping[str, Any]) -> str:
    """Its first held-out image, or its first; from the last index where that is as new."""
    image = _first_image(results)
    if image is None:
        return ""
    if kept.get("time") == image.stat().st_mtime_ns and isinstance(kept.get("src"), str):
        return kept["src"]
    try:
        pixels = read_rgb(image)
    except (FiptError, *MALFORMED):
        return ""
    return embedded(display.tone_mapped(pixels, display.common_exposure([pixels])), THUMBNAIL)[0]


def _first_image(results: Path) -> Path | None:
    frames = _content(results / "dataset" / "transforms.json").get("frames") or []
    try:
        first = sorted(frames, key=lambda frame: frame.get("split") != "val")
        found = [results / "dataset" / str(frame["file_path"]) for frame in first[:1]]
    except MALFORMED:
        return None
    return next((path for path in found if path.is_file()), None)


KEPT = ".thumbnails.json"
"""Thumbnails of the last index: most rooms of a thousand have not changed."""


def _kept_thumbnails(folder: Path) -> dict[str, Any]:
    return _content(folder / KEPT)


def thumbnails(folder: Path, rows: Sequence[RoomRow]) -> dict[str, Any]:
    """What `KEPT` has: the thumbnails with the times of their images."""
    images = {row.name: _first_image(folder / row.name) for row in rows if row.thumbnail}
    shown = {row.name: row.thumbnail for row in rows}
    return {
        name: {"time": image.stat().st_mtime_ns, "src": shown[name]}
        for name, image in images.items()
        if image is not None
    }
