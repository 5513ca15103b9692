"""What ``fipt run`` shows of Snakemake: jobs that start and end, their progress, and in one line why one failed.

A logger plugin of Snakemake: it gets every event of a run. What a running job is at, it reads in the job's log.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from logging import LogRecord
from pathlib import Path
from typing import Any, ClassVar

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from fipt.cli import IGNORED, end
from fipt.errors import EXIT_CODE
from fipt.outcome import OUR_LINE
from fipt.progress import INTERVAL

_SYSTEM = re.compile(r"^(?:\w*Error): \[Errno \d+\] ([^:]+): '([^']+)'$", re.MULTILINE)
"""How Python says that the system refuses a file."""

_PROGRESS = re.compile(r"^(.+ (\d+)%  .*?)\s*$")
"""A line of `fipt.progress` in a log."""


class _Job:
    """A job that runs: its name, and what its log says so far."""

    def __init__(self, log: str) -> None:
        self.log, self.label = Path(log), Path(log).stem
        self.start = time.perf_counter()
        self._read = 0

    @property
    def seconds(self) -> float:
        """Time since its start."""
        return time.perf_counter() - self.start

    def news(self) -> list[str]:
        """Lines that the log has got since the last call."""
        with contextlib.suppress(OSError), self.log.open("rb") as file:
            file.seek(self._read)
            found = file.read()
            whole = found[: found.rfind(b"\n") + 1]
            self._read += len(whole)
            return whole.decode(errors="replace").splitlines()
        return []


class LogHandler(LogHandlerBase):
    """Shows a run while it goes on; `conclude` says how it ended."""

    last: ClassVar[LogHandler]
    """The one that Snakemake made for this run."""

    # What Snakemake wants to know: nothing else may write to the terminal, and every event comes here.
    writes_to_stream = property(lambda self: True)
    writes_to_file = property(lambda self: False)
    has_filter = property(lambda self: True)
    has_formatter = property(lambda self: True)
    needs_rulegraph = property(lambda self: False)

    def __post_init__(self) -> None:
        """Begin with nothing seen."""
        LogHandler.last = self
        self.interrupted = 0  # or the signal that did
        self.running: dict[int, _Job] = {}
        self._failed: list[_Job] = []
        self._errors: list[Any] = []
        self._started = self._total = 0
        self._dry = self.common_settings.dryrun
        self._screen = _Bars() if sys.stderr.isatty() and not self._dry else _Lines()
        self._changing = threading.Lock()
        self._over = threading.Event()
        threading.Thread(target=self._follow, daemon=True).start()

    @property
    def jobs_failed(self) -> bool:
        """Whether some jobs have failed."""
        return bool(self._failed)

    def emit(self, record: LogRecord) -> None:
        """Take an event of the run."""
        event: Any = record  # its fields depend on what it is
        kind = getattr(record, "event", None)
        with self._changing:
            if kind == LogEvent.RUN_INFO and not self._total:
                self._total = event.stats["total"]
            elif kind == LogEvent.JOB_INFO and event.log:  # a job without a log only names a target
                self._begin(event)
            elif kind in (LogEvent.JOB_FINISHED, LogEvent.JOB_ERROR):
                failed = kind == LogEvent.JOB_ERROR
                self._end(event.jobid if failed else event.job_id, failed)
            elif kind == LogEvent.ERROR:
                self._errors.append(event)
            elif str(event.msg).startswith("Nothing to be done"):
                self._screen.line("everything is up to date")

    def close(self) -> None:
        """Stop to watch."""
        self._over.set()
        self._screen.close()
        super().close()

    def conclude(self, done: bool, listed: bool = False) -> int:
        """Say why the run failed, if it did, in one line where the user can mend it; return the exit code.

        Parameters
        ----------
        done
            Whether it did not fail.
        listed
            Whether the workflow has named the jobs that failed.
        """
        if self.interrupted:
            if self.interrupted != signal.SIGINT:  # of which `main` tells
                _tell("terminated")
            return 128 + self.interrupted
        if done:
            return 0
        if listed and self._failed:
            return EXIT_CODE
        codes = [_explain_job(job) for job in self._failed] or [_explain_error(event) for event in self._errors]
        return max(codes, key=lambda code: code != EXIT_CODE, default=1)

    def _begin(self, event: Any) -> None:
        self._started += 1
        job = _Job(event.log[0])
        # the target is one of the jobs that Snakemake counts
        head = f"[{self._started}/{max(self._total - 1, self._started)}] {job.label}"
        if self._dry:
            self._screen.line(f"{head}: {_shortened(event.reason)}")
            return
        self.running[event.jobid] = job
        self._screen.begin(job, head)

    def _end(self, jobid: int, failed: bool) -> None:
        job = self.running.pop(jobid, None)
        if job is None:
            return
        self._tell_news(job)
        self._screen.end(job, failed)
        if failed:
            self._failed.append(job)

    def _follow(self) -> None:
        """Look at the logs of the running jobs until the run is over."""
        while not self._over.wait(self._screen.interval):
            with self._changing:
                for job in self.running.values():
                    self._tell_news(job)

    def _tell_news(self, job: _Job) -> None:
        lines = job.news()
        for line in lines:
            if line.startswith("warning: "):
                self._screen.line(f"{job.label}: {line}")
        steps = [match for match in map(_PROGRESS.match, lines) if match]
        if steps:
            self._screen.step(job, steps[-1][1], int(steps[-1][2]))


class _Lines:
    """Plain lines on standard error, for files and pipes."""

    interval = INTERVAL

    def line(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def begin(self, job: _Job, head: str) -> None:
        self.line(head)

    def step(self, job: _Job, text: str, percent: int) -> None:
        self.line(f"{job.label}: {text}")

    def end(self, job: _Job, failed: bool) -> None:
        self.line(f"{job.label}: {'failed after ' if failed else ''}{job.seconds:.1f} s")

    def close(self) -> None:
        pass


class _Bars(_Lines):
    """A bar for each running job below the lines of those that are done, on a terminal."""

    interval = 0.5

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        os.environ["FIPT_PROGRESS_INTERVAL"] = "1"  # for the jobs: their logs feed the bars
        columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[text]}")
        self._bars = Progress(*columns, console=Console(stderr=True), transient=True)
        self._tasks: dict[_Job, Any] = {}
        self._bars.start()

    def line(self, text: str) -> None:
        self._bars.console.print(text, markup=False, highlight=False)

    def begin(self, job: _Job, head: str) -> None:
        self._tasks[job] = self._bars.add_task(head, total=None, text="")

    def step(self, job: _Job, text: str, percent: int) -> None:
        self._bars.update(self._tasks[job], total=100, completed=percent, text=text)

    def end(self, job: _Job, failed: bool) -> None:
        self._bars.remove_task(self._tasks.pop(job))
        super().end(job, failed)

    def close(self) -> None:
        self._bars.stop()


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the run and the jobs that run: Snakemake alone would wait for these."""
    from snakemake.scheduling.job_scheduler import JobScheduler
    from snakemake.shell import shell

    def interrupt(number: int, frame: Any) -> None:
        if not hasattr(LogHandler, "last"):  # Snakemake has not begun
            end(number, frame)
        LogHandler.last.interrupted = LogHandler.last.interrupted or number
        for jobid in list(LogHandler.last.running):
            shell.terminate(jobid)
        raise KeyboardInterrupt

    # what Snakemake does on SIGTERM once jobs run, which is to wait for them
    setattr(JobScheduler, "exit_gracefully", lambda _, number, frame: interrupt(number, frame))  # noqa: B010 - no method
    heard = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP} - set(IGNORED)
    before = {number: signal.signal(number, interrupt) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupted() -> int:
    """The signal that has interrupted the run; 0: none."""
    return LogHandler.last.interrupted if hasattr(LogHandler, "last") else 0


def jobs_failed() -> bool:
    """Whether jobs ran and some of them failed; not where Snakemake has not begun."""
    return hasattr(LogHandler, "last") and LogHandler.last.jobs_failed


def _explain_job(job: _Job) -> int:
    """Say in one line why a job failed, if its log has one; else show the end of the log."""
    text = job.log.read_text(encoding="utf-8", errors="replace") if job.log.exists() else ""
    ours = OUR_LINE.findall(text)
    if ours:
        _tell(f"error: {ours[-1]}")
        return EXIT_CODE
    print(*text.splitlines()[-30:], sep="\n", file=sys.stderr)
    _tell(f"error: {job.label} failed; the whole log is {job.log}")
    return 1


def _explain_error(event: Any) -> int:
    """Say in one line why there is nothing to run, if the user can mend it; else all that Snakemake says."""
    text = str(event.msg)
    ours = OUR_LINE.findall(text)
    if ours:
        _tell(f"error: {ours[-1]}")
    elif event.exception == "MissingInputException":
        rule, files = re.search(r"for rule (\w+)", text), text.partition("affected files:")[2].split()
        _tell(f"error: an input of {rule[1] if rule else 'a rule'} is missing: {', '.join(files)}; check the path")
    elif event.exception == "MissingRuleException":
        said = text.splitlines()[-1].partition(" (if you use input functions")[0]
        _tell(f"error: {said}; 'fipt run --help' lists the targets")
    elif found := _SYSTEM.search(text):
        _tell(f"error: Snakemake cannot use {found[2]} ({found[1]}); check its permissions, HOME and TMPDIR")
    else:
        print(text, file=sys.stderr)
        return 1
    return EXIT_CODE


def _tell(text: str) -> None:
    print(f"fipt: {text}", file=sys.stderr)


def _shortened(reason: str) -> str:
    return reason if len(reason) < 100 else f"{reason[:97]}..."
