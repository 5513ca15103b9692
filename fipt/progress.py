"""Progress bars with a rate, on standard error; plain lines where that is not a terminal."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

_QUIET_INTERVAL = 20.0
"""Seconds between lines where no terminal shows a bar (logs)."""


class Progress:
    """Counts work done; `advance` moves the bar or now and then writes a line."""

    def __init__(self, label: str, total: float, unit: str) -> None:
        self.label, self.total, self.unit = label, max(total, 1), unit
        self.done, self.start = 0.0, time.perf_counter()
        self._last = self.start

    @property
    def rate(self) -> float:
        """Work done per second since the start."""
        return self.done / max(time.perf_counter() - self.start, 1e-9)

    def advance(self, amount: float = 1.0, note: str = "") -> None:
        """Add ``amount`` units of work; ``note`` (a loss, say) is shown beside the rate."""
        self.done += amount
        now = time.perf_counter()
        terminal = sys.stderr.isatty()
        if now - self._last < (0.2 if terminal else _QUIET_INTERVAL) and self.done < self.total:
            return
        self._last = now
        self._show("\r" if terminal else "", note, "" if terminal else "\n")

    def _show(self, before: str, note: str, after: str) -> None:
        share = min(self.done / self.total, 1.0)
        filled = int(24 * share)
        bar = f"[{'#' * filled}{'.' * (24 - filled)}]"
        text = f"{self.label} {bar} {share:4.0%}  {human(self.rate)}{self.unit}/s  {note}"
        sys.stderr.write(f"{before}{text:<78}{after}")
        sys.stderr.flush()


@contextmanager
def progress(label: str, total: float, unit: str = "") -> Iterator[Progress]:
    """Show progress of a step: ``label``, ``total`` units of work, ``unit`` for the rate (" rays", " steps")."""
    bar = Progress(label, total, unit)
    yield bar
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    seconds = time.perf_counter() - bar.start
    sys.stderr.write(f"{label}: {human(bar.done)}{unit} in {seconds:.1f} s ({human(bar.rate)}{unit}/s)\n")
    sys.stderr.flush()


def human(value: float) -> str:
    """Format a count with k, M or G."""
    for limit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g}{letter}"
    return f"{value:.3g}"
