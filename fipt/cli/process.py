"""What the command line sets up once for its process: messages on standard error, and how the process ends."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

LEVELS = ("debug", "info", "warning", "error")


class StandardError(logging.Handler):
    """Writes records as plain lines: no prefix for information, the level before anything worse."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record to what is standard error now."""
        level = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        print(f"{level}{self.format(record)}", file=sys.stderr, flush=True)


def set_thread_defaults() -> None:
    """Tell libraries that are imported later how to use threads, where nobody else has told them.

    OpenMP threads that wait by spinning would starve the tracer's own (seen: 10 times slower steps). A second thread
    for products of matrices in numpy and scipy takes more time by waiting than it saves, where they are small (seen: 7
    times slower minimisations); and sums would depend on the number of threads.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def configure_logging(level: str = "") -> None:
    """Send the messages of fipt to standard error; a second call only changes the level.

    Parameters
    ----------
    level : str
        debug, info, warning or error; empty: the variable FIPT_LOG, else info.
    """
    logger = logging.getLogger("fipt")
    if not any(isinstance(handler, StandardError) for handler in logger.handlers):
        logger.addHandler(StandardError())
    named = (level or os.environ.get("FIPT_LOG", "")).lower()
    logger.setLevel((named if named in LEVELS else "info").upper())


def is_job() -> bool:
    """Whether a rule of the workflow called this process (fipt/workflow/rules/common.smk)."""
    return os.environ.get("FIPT_RUN") == str(os.getppid())


def end_with_parent(parent: int) -> None:
    """Let the system kill this process when ``parent`` is killed, so that none works on unseen (Linux)."""
    if sys.platform == "linux":
        kill_when_parent_ends = 1  # PR_SET_PDEATHSIG of linux/prctl.h
        ctypes.CDLL(None).prctl(kill_when_parent_ends, signal.SIGKILL)
        if os.getppid() != parent:  # it was killed before
            os._exit(1)


def leave(code: int) -> NoReturn:
    """End the process at once: to take libraries down in order costs half a second with torch, and all is written."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # they may be closed
            with suppress(OSError):  # nobody reads any more
                stream.flush()
    os._exit(code)
