"""A stage in a process of its own, watched by a small one: crash, kill, hang and Ctrl-C end with one line each.

Libraries may abort the process, be killed for the memory they take, or take a Ctrl-C for a failure of an import. The
watching process has loaded none of them. It starts the other by a fork, so this costs a few milliseconds.
"""

from __future__ import annotations

import faulthandler
import os
import re
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from fipt.cli import IGNORED
from fipt.cli.process import end_with_parent, leave
from fipt.errors import EXIT_CODE

GRACE = 5.0
"""Seconds that an interrupted stage has for tidying up: kernels of Dr.Jit cannot be interrupted."""
HANG = 900.0
"""Seconds without any work of processors after which a stage counts as hanging."""
_WORK = 0.1
"""Seconds of processors in that time that are no work: threads that wait wake up at times."""
_INTERVAL = 1.0
"""Seconds after which the process is looked at again."""
_WORDS: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "terminated"}
_SAID = {number: word for number, word in _WORDS.items() if number not in IGNORED}


def guarded(name: str, call: Callable[[], int], hang: float = HANG) -> int:
    """Call a function in a forked process; return its exit code, or say in one line what ended it.

    Parameters
    ----------
    name
        Of the verb, for that line.
    call
        Returns an exit code.
    hang
        Seconds without work after which it is ended.
    """
    watcher = os.getpid()
    heard, own = os.pipe()  # it ends with the process, and holds what that says of a crash
    signal.pthread_sigmask(signal.SIG_BLOCK, _SAID)  # until both know what to do
    pid = os.fork()
    if pid == 0:
        os.close(heard)
        _be_watched(watcher, own, call)
    os.close(own)
    received, status = _Watch(pid, heard, hang).wait()
    code = os.waitstatus_to_exitcode(status)
    if received is None and code == 128 + signal.SIGINT:
        received = signal.SIGINT
    if received is not None and received in _SAID:
        print(f"fipt: {_SAID[received]}", file=sys.stderr, flush=True)
        return 128 + received
    if received is None and code >= 0:
        return code
    print(f"fipt: error: {_fate(name, received, -code, _text(heard), hang)}", file=sys.stderr, flush=True)
    return EXIT_CODE


def _be_watched(watcher: int, own: int, call: Callable[[], int]) -> NoReturn:
    """Be the process of the stage: end with the watching one, tidy up when interrupted, leave a trace of a crash."""
    end_with_parent(watcher)
    faulthandler.enable(own, all_threads=False)
    for number in _SAID:
        signal.signal(number, _interrupt)
    code = 1
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SAID)
        code = call()
    except BaseException as error:  # noqa: BLE001 - a mistake in the program keeps its traceback
        sys.excepthook(type(error), error, error.__traceback__)
    leave(code)


def _interrupt(number: int, frame: Any) -> NoReturn:
    """Raise KeyboardInterrupt once, and say nothing any more: the watching process does."""
    for other in _SAID:
        signal.signal(other, signal.SIG_IGN)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    raise KeyboardInterrupt


class _Watch:
    """Waits for the end of a process and hands signals on to it; ends it when it hangs."""

    def __init__(self, pid: int, heard: int, hang: float) -> None:
        self._pid, self._heard, self._hang = pid, heard, hang
        self._received: int | None = None
        self._deadline = float("inf")

    def wait(self) -> tuple[int | None, int]:
        """The signal that was handed on (SIGALRM: it hung; None: none), and the status of the process."""
        for number in _SAID:
            signal.signal(number, self._hand_on)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SAID)
        begin, worked = time.monotonic(), _processor_time(self._pid)
        while True:
            select.select([self._heard], [], [], _INTERVAL)  # readable when the process has ended
            done, status = os.waitpid(self._pid, os.WNOHANG)
            if done:
                return self._received, status
            now, work = time.monotonic(), _processor_time(self._pid)
            if work is None or worked is None or work > worked + _WORK:
                begin, worked = now, work
            if now > begin + self._hang and self._received is None:
                self._received, self._deadline = signal.SIGALRM, now
            if now > self._deadline:
                os.kill(self._pid, signal.SIGKILL)

    def _hand_on(self, number: int, frame: Any) -> None:
        if self._received is None:
            self._received, self._deadline = number, time.monotonic() + GRACE
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(self._pid, number)


def _processor_time(pid: int) -> float | None:
    """Seconds of processors that a process and those it has started have used; None: unknown, or it was stopped."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        children = [
            child for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()
        ]
    except OSError:
        return None
    if fields[0] == "T":
        return None
    own = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # children that have ended too
    return own + sum(_processor_time(int(child)) or 0.0 for child in children)


def _text(heard: int) -> str:
    """What a process said of its crash; one that it started may still hold the other end."""
    os.set_blocking(heard, False)
    try:
        return os.read(heard, 1 << 16).decode(errors="replace")
    except BlockingIOError:
        return ""


def _fate(name: str, received: int | None, number: int, trace: str, hang: float) -> str:
    """Say how a process ended that did not return."""
    calls = re.findall(r'File "(.+)", line (\d+) in (\S+)', trace)
    own = [call for call in calls if "/fipt/" in call[0] and "/fipt/cli/" not in call[0]]
    where = f" in {own[0][2]}, {Path(own[0][0]).name}:{own[0][1]}" if own else ""
    again = "run again: what is done stays; if it stays so, report it"
    if received == signal.SIGALRM:
        return f"fipt {name} hung: no processor worked for it for {hang:.0f} s; {again}"
    if number == signal.SIGKILL:
        return (
            f"fipt {name} was killed (SIGKILL), most likely by the system for lack of memory; "
            "close other programs, or use fewer cores or smaller images"
        )
    return f"fipt {name} crashed in native code ({signal.Signals(number).name}{where}); {again}"
