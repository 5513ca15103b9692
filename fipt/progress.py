"""Progress of a step with its rate: a bar on a terminal, now and then a line in a log."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

INTERVAL = float(os.environ.get("FIPT_PROGRESS_INTERVAL", "20"))
"""Seconds between two lines of a log; ``fipt run`` on a terminal asks for more of them, which it turns into bars."""

_REDRAW = 0.1
"""Seconds between two looks of a bar."""


class Progress:
    """Counts work done; `advance` moves the bar or now and then writes a line.

    Attributes
    ----------
    label : str
        What is done.
    total, done : float
        Units of work.
    start : float
        When it began, seconds of `time.perf_counter`.
    """

    def __init__(
        self, label: str, total: float, unit: str, show: Callable[[Progress, str], None], every: float
    ) -> None:
        self.label, self.total, self.done = label, max(total, 1), 0.0
        self._unit, self._show, self._every = unit, show, every
        self.start = self._last = time.perf_counter()

    @property
    def rate(self) -> float:
        """Work done per second since the start."""
        return self.done / max(time.perf_counter() - self.start, 1e-9)

    @property
    def pace(self) -> str:
        """The rate for people, with its unit."""
        return f"{human(self.rate)}{self._unit}/s"

    def advance(self, amount: float = 1.0, note: str = "") -> None:
        """Add ``amount`` units of work; ``note`` (a loss, say) is shown beside the rate."""
        self.done += amount
        now = time.perf_counter()
        if now - self._last >= self._every or (self._every == _REDRAW and self.done >= self.total):
            self._last = now
            self._show(self, note)

    def conclude(self) -> None:
        """Say how much was done in which time."""
        seconds = time.perf_counter() - self.start
        log.info("%s: %s%s in %.1f s (%s)", self.label, human(self.done), self._unit, seconds, self.pace)


@contextmanager
def progress(label: str, total: float, unit: str = "") -> Iterator[Progress]:
    """Show progress of a step on standard error.

    Parameters
    ----------
    label : str
        What is done.
    total : float
        Units of work.
    unit : str
        For the rate, with a blank before it: " rays", " steps".
    """
    if sys.stderr.isatty():
        with _bar(label) as show:
            step = Progress(label, total, unit, show, _REDRAW)
            yield step
    else:
        step = Progress(label, total, unit, _line, INTERVAL)
        yield step
    step.conclude()


def _line(step: Progress, note: str) -> None:
    share = min(step.done / step.total, 1.0)
    log.info("%s %.0f%%  %s  %s", step.label, 100 * share, step.pace, note)


@contextmanager
def _bar(label: str) -> Iterator[Callable[[Progress, str], None]]:
    """A bar of rich that vanishes at the end; yields what moves it."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bars

    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[pace]}")
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(label, total=1.0, pace="")
        yield lambda step, note: bars.update(task, completed=step.done / step.total, pace=f"{step.pace}  {note}")


def human(value: float) -> str:
    """Format a count with k, M or G."""
    for limit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g}{letter}"
    return f"{value:.3g}"
