"""The command line: `main.py` finds the verb, each verb is one thin module beside it."""

import os
import signal
import sys
from typing import Any

IGNORED = (signal.SIGHUP,) if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else ()
"""Signals that this process was started to ignore: nohup lets work go on when its terminal closes."""


def end(number: int, frame: Any) -> None:
    """End at once, with a word: nothing has begun that must be tidied up."""
    os.write(2, b"fipt: interrupted\n" if number == signal.SIGINT else b"fipt: terminated\n")
    os._exit(128 + number)


if os.path.basename(sys.argv[0]) in ("fipt", "-m"):  # noqa: PTH119 - pathlib takes longer than all that it protects
    # the program itself begins: while modules are loaded, Ctrl-C would be a traceback
    for _number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if _number not in IGNORED:
            signal.signal(_number, end)
