"""Calls of native libraries that may hang or crash, each in a Python process of its own.

The process gets arrays in a file and returns arrays in a file, so nothing is pickled. It has a time limit, and is
started again when it hangs or crashes. So a fault in a library costs an attempt, not the run.
"""

import importlib
import json
import logging
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fipt.errors import EXIT_CODE, FiptError, shortage
from fipt.formats.arrays import load_npz, save_npz

log = logging.getLogger(__name__)

ATTEMPTS = 3
"""How often a call is tried."""
_GRACE = 10
"""Seconds after the limit at which a process ends itself, should nobody be left to end it."""


def run_in_child(
    function: Callable[..., Mapping[str, np.ndarray]],
    arguments: Mapping[str, Any],
    limit: float,
    cpus: int | None = None,
    attempts: int = ATTEMPTS,
) -> dict[str, np.ndarray]:
    """Call a function in a process of its own, and again if that hangs or crashes.

    Parameters
    ----------
    function
        A public function of a module that imports little: the process starts for every call.
    arguments
        Name -> array, number or text.
    limit
        Seconds after which a call counts as hanging.
    cpus
        The process is bound to so many CPUs, where the system can do that; None: as this one.
    attempts
        How often it is tried.

    Returns
    -------
    dict
        The arrays that the function returned.

    Raises
    ------
    FiptError
        If the function raises one, or every attempt hangs or crashes.
    RuntimeError
        If the function raises anything else; the text holds its traceback.
    """
    name = f"{function.__module__}:{function.__qualname__}"
    fate = ""
    with TemporaryDirectory(prefix="fipt-") as place:
        folder = Path(place)
        save_npz(folder / "arguments.npz", **{key: np.asarray(value) for key, value in arguments.items()})
        for attempt in range(1, attempts + 1):
            fate = _attempt(name, folder, limit, cpus)
            if not fate:
                return load_npz(folder / "result.npz")
            if attempt < attempts:
                log.warning("%s %s in attempt %d of %d; it is tried again", name, fate, attempt, attempts)
    raise FiptError(f"{name} {fate} in each of {attempts} attempts", "run again; if it stays so, report it")


def _attempt(name: str, folder: Path, limit: float, cpus: int | None) -> str:
    """Run the process once; empty where it returned, else how it failed."""
    chosen = ",".join(map(str, _chosen_cpus(cpus)))
    command = [sys.executable, "-P", "-m", __name__, name, str(folder), str(math.ceil(limit) + _GRACE), chosen]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    with open(folder / "stderr.txt", "wb") as errors:
        try:
            code = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                env=environment,
                timeout=limit,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return f"did not end within {limit:.0f} s"
    if code == 0:
        return ""
    said = (folder / "stderr.txt").read_text(encoding="utf-8", errors="replace").strip()
    if code == EXIT_CODE:
        raise FiptError(*json.loads((folder / "error.json").read_text(encoding="utf-8")))
    if code == 1:  # a mistake in the program: trying again would not mend it
        raise RuntimeError(f"{name} failed in its process:\n{said}")
    reason = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    return f"{reason} ({said.splitlines()[-1]})" if said else reason


def _chosen_cpus(count: int | None) -> list[int]:
    """CPUs of this process that its child may use; none named where it may use all, or the system cannot choose."""
    if count is None or not hasattr(os, "sched_getaffinity"):
        return []
    usable = sorted(os.sched_getaffinity(0))
    first = os.getpid() % len(usable)  # several runs at once take different ones
    return (usable[first:] + usable[:first])[:count]


def main(name: str, folder: str, lifetime: str, cpus: str) -> None:
    """Be the process: read the arguments, call the function, write what it returns."""
    place = Path(folder)
    if cpus:
        os.sched_setaffinity(0, map(int, cpus.split(",")))
    if hasattr(signal, "alarm"):
        signal.alarm(int(lifetime))  # ends a hanging process even when its parent was killed
    module, _, function = name.partition(":")
    arguments = {key: value[()] for key, value in load_npz(place / "arguments.npz").items()}
    try:
        result = getattr(importlib.import_module(module), function)(**arguments)
    except FiptError as error:
        (place / "error.json").write_text(json.dumps([error.message, error.remedy]), encoding="utf-8")
        sys.exit(EXIT_CODE)
    except (MemoryError, OSError, RuntimeError) as error:
        if (short := shortage(error)) is None:
            raise
        (place / "error.json").write_text(json.dumps([short.message, short.remedy]), encoding="utf-8")
        sys.exit(EXIT_CODE)
    save_npz(place / "result.npz", **result)
    os._exit(0)  # no destructor of a library runs any more: some hang


if __name__ == "__main__":
    main(*sys.argv[1:])
