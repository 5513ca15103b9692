"""Times of functions that take turns, and the memory that a function adds."""

import ctypes
import gc
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Ratio:
    """How many times one series of measurements exceeds another; low and high are the extremes over the repeats."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, more: Sequence[float], less: Sequence[float]) -> "Ratio":
        """Ratio of the medians; the spread is that of the repeats, each taken with its neighbour in time."""
        pairs = [a / b for a, b in zip(more, less, strict=True)]
        return cls(statistics.median(more) / statistics.median(less), min(pairs), max(pairs))

    def __str__(self) -> str:
        spread = "" if self.low == self.high else f" ({self.low:.2g}-{self.high:.2g})"
        return f"{self.median:.2g}x{spread}"


def in_turns(
    functions: Mapping[str, Callable[[], object]], repeats: int, least: float = 0.0, warm: bool = True
) -> dict[str, list[float]]:
    """Seconds of every call of every function.

    The functions take turns, so that whatever else the machine does slows all of them down alike. Each must return
    only when its work is done.

    Parameters
    ----------
    repeats
        Calls of each.
    least
        A quick function is called again within its turn until this many seconds have passed; the mean counts.
    warm
        Call each once before, untimed: kernels are compiled then.
    """
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values() if warm else ():
        function()
    for _ in range(repeats):
        for name, function in functions.items():
            start, calls = time.perf_counter(), 0
            while calls == 0 or time.perf_counter() - start < least:
                function()
                calls += 1
            times[name].append((time.perf_counter() - start) / calls)
    return times


def added_memory(function: Callable[[], object]) -> float | None:
    """Megabytes by which a call raises the peak of this process's memory; None where the system does not tell.

    Counts the host's memory alone, and pages that the libraries' pools take from the system: these are emptied before.
    """
    if sys.platform != "linux":
        return None
    _release_pools()
    Path("/proc/self/clear_refs").write_text("5")  # makes the peak start again from here
    before = _status("VmRSS")
    function()
    return (_status("VmHWM") - before) / 1024


def _release_pools() -> None:
    import drjit as dr

    gc.collect()
    dr.sync_thread()
    dr.flush_malloc_cache()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only
    if trim is not None:
        trim(0)


def _status(key: str) -> int:
    """A figure of /proc/self/status, kilobytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))
