"""Functions for processes of their own (`fipt.child`), and an xatlas that fails as often as a test wants."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from fipt.errors import FiptError

_XATLAS = '''
"""Fails {failures} times by {failure}, then is the real one."""
import os, pathlib, signal, sys, time
here = pathlib.Path(__file__).parent
with open(here / "attempts", "a") as file:
    file.write("x")
if (here / "attempts").stat().st_size <= {failures}:
    if "{failure}" == "hang":
        time.sleep(600)
    os.kill(os.getpid(), signal.SIGSEGV)
sys.path.remove(str(here))
del sys.modules["xatlas"]
import xatlas
'''


def plant_xatlas(folder: Path, failure: str, failures: int) -> Path:
    """Write a module xatlas that hangs (``hang``) or crashes (``crash``); its folder goes to the front of sys.path."""
    (folder / "xatlas.py").write_text(_XATLAS.format(failure=failure, failures=failures))
    return folder


def attempts(folder: Path) -> int:
    """How often that module was imported."""
    return (folder / "attempts").stat().st_size


# --- functions to call ----------------------------------------------------------------------------


def doubled(values, text):
    return {"values": 2 * values, "text": np.array(f"{text}!")}


def own_cpus():
    return {"cpus": np.array(sorted(os.sched_getaffinity(0)))}


def failing(folder, failure, failures):
    """Hang, crash or abort in the first attempts, then return which one it is."""
    count = len(list(Path(str(folder)).iterdir())) + 1
    (Path(str(folder)) / str(count)).touch()
    if count <= failures:
        if failure == "hang":
            time.sleep(600)
        os.kill(os.getpid(), {"crash": signal.SIGSEGV, "abort": signal.SIGABRT}[str(failure)])
    return {"attempt": np.array(count)}


def refusing():
    raise FiptError("the charts do not fit", "raise the limit")


def mistaken():
    raise ValueError("a mistake in the program")


class Library:
    """Hangs when it is destroyed, as xatlas does at times."""

    def __del__(self):
        time.sleep(600)


kept = []


def destructor_that_hangs():
    kept.append(Library())
    return {"done": np.array(True)}


def objects():
    return {"values": np.array([{}], dtype=object)}
