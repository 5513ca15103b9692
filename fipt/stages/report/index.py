"""results/index.html and summary.tsv: all rooms on one page and in one table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.stages.report.content import TILES
from fipt.stages.report.page import filled
from fipt.stages.report.rooms import KEPT, STATES, RoomFigure, RoomRow, read_rooms, thumbnails

INDEX, SUMMARY = "index.html", "summary.tsv"

_COMPARISON = "compare"
"""What several rooms have together, which is no room."""

_BINS = 16
"""Bars of a distribution."""


@dataclass(frozen=True)
class Bar:
    """A bar of a distribution: values from ``low`` to ``high``, how many rooms, its height in [0, 1]."""

    low: float
    high: float
    rooms: int
    height: float


@dataclass(frozen=True)
class Spread:
    """How a figure is distributed over rooms: its bars, the median, and the room with the worst value."""

    figure: RoomFigure
    bars: Sequence[Bar]
    rooms: int
    median: float
    worst: float
    worst_room: str


@dataclass(frozen=True)
class StageShare:
    """Time of a stage over all rooms: seconds, jobs' rooms, its share of the longest in [0, 1]."""

    stage: str
    seconds: float
    rooms: int
    share: float


def write_index(folder: Path) -> int:
    """Write index.html and summary.tsv of the rooms in a folder of results; return their number.

    Parameters
    ----------
    folder
        Of all results; every folder in it that a run made is a room.

    Raises
    ------
    FiptError
        If there is no such folder, or no room in it.
    """
    if not folder.is_dir():
        raise FiptError(f"the results folder {folder} does not exist", "run a room first")
    names = sorted({path.parent.name for path in folder.glob("*/logs/")} - {_COMPARISON})
    if not names:
        raise FiptError(f"{folder} holds no room", "run a room first")
    rows, figures = read_rooms(folder, names, TILES)
    write_text(folder / INDEX, index_page(rows, figures))
    write_text(folder / SUMMARY, "".join("\t".join(cells) + "\n" for cells in _table(rows, figures)))
    write_text(folder / KEPT, json.dumps(thumbnails(folder, rows)))
    return len(rows)


def index_page(rows: Sequence[RoomRow], figures: Sequence[RoomFigure]) -> str:
    """Return the page of all rooms: HTML that loads nothing from anywhere."""
    return filled(
        "index.html",
        ("style.css", "index.css"),
        ("index.js",),
        rows=rows,
        figures=figures,
        counts={state: sum(row.state == state for row in rows) for state in STATES},
        serious=sum(bool(row.serious) for row in rows),
        spreads=[spread for figure in figures if (spread := _spread(figure, rows)) is not None],
        stages=stage_shares(rows),
        total=sum(row.total for row in rows),
    )


def _spread(figure: RoomFigure, rows: Sequence[RoomRow]) -> Spread | None:
    known = [(row.figures[figure.key], row.name) for row in rows if figure.key in row.figures]
    if len(known) < 2:
        return None
    values = sorted(value for value, _ in known)
    low, high = values[0], values[-1]
    width = (high - low) / _BINS  # 0 where all rooms have the same figure: one bar, in the middle
    counts = [0] * _BINS
    for value in values:
        counts[min(int((value - low) / width), _BINS - 1) if width else _BINS // 2] += 1
    bars = [Bar(low + width * k, low + width * (k + 1), count, count / max(counts)) for k, count in enumerate(counts)]
    worst, room = max(known, key=lambda each: figure.worse(each[0]))
    return Spread(figure, bars, len(known), values[len(values) // 2], worst, room)


def stage_shares(rows: Sequence[RoomRow]) -> list[StageShare]:
    """Time of every stage over all rooms, the longest first."""
    seconds: dict[str, list[float]] = {}
    for row in rows:
        for stage, value in row.seconds.items():
            seconds.setdefault(stage, []).append(value)
    sums = {stage: sum(values) for stage, values in seconds.items()}
    longest = max(sums.values(), default=0.0) or 1.0
    found = [StageShare(stage, sums[stage], len(values), sums[stage] / longest) for stage, values in seconds.items()]
    return sorted(found, key=lambda each: -each.seconds)


def _table(rows: Sequence[RoomRow], figures: Sequence[RoomFigure]) -> Iterator[list[str]]:
    """Lines of summary.tsv: a head, then a room each, in the order of the page."""
    stages = [each.stage for each in stage_shares(rows)]
    yield [
        *("room", "state", "failed", "serious", "warnings", "finding", "seconds", "peak_memory_mb", "views"),
        *(figure.key for figure in figures),
        *(f"seconds.{stage}" for stage in stages),
    ]
    for row in rows:
        yield [
            *(row.name, row.state, _plain(row.why)),
            *("" if count is None else str(count) for count in (row.serious, row.warnings)),
            *(_plain(row.finding), f"{row.total:.1f}", f"{row.memory / 1e6:.0f}"),
            "training" if row.of_training else "held out" if row.figures else "",
            *(f"{row.figures[figure.key]:.6g}" if figure.key in row.figures else "" for figure in figures),
            *(f"{row.seconds[stage]:.1f}" if stage in row.seconds else "" for stage in stages),
        ]


def _plain(text: str) -> str:
    """Text that can stand in a cell of a table."""
    return " ".join(text.split())
