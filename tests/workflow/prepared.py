"""Programs of the workflow as forks of one process that has imported them: most of a dry run's time is imports.

A fork has its own working directory, environment, output and exit code, as a program that is started has.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from benchmarks import jobs

PROGRAMS = {"snakemake": "snakemake.cli:main", "fipt.cli.main": "fipt.cli.main:program"}
"""Module as ``python -m`` takes it -> its function."""
IMPORTED = (
    *("fipt.cli.run", "fipt.cli.run_view", "fipt.cli.verbs", "fipt.config", "fipt.config.kept", "fipt.lock"),
    *("fipt.provenance", "fipt.scene.objects", "fipt.scene.references", "jsonschema", "referencing", "requests"),
    *("smart_open", "snakemake.cli", "snakemake.utils", "yte"),
)
LONGEST = 900
"""Seconds after which a program is ended."""


def run(
    module: str, options: Sequence[str], folder: Path, environment: Mapping[str, str], merged: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run ``python -m MODULE OPTIONS`` in a folder; standard error lies in standard output where it is ``merged``."""
    if environment.get("PYTHONPATH") != str(jobs.REPOSITORY):  # other modules than those that were imported
        done = jobs.started(module, options, folder, environment)
        done.stdout += done.stderr if merged else ""
        return done
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    with tempfile.TemporaryDirectory() as place:
        out = Path(place, "out")
        error = out if merged else Path(place, "error")
        asked = {
            "module": module,
            "options": list(options),
            "folder": str(Path(folder).absolute()),
            "environment": dict(environment),
        }
        print(json.dumps(asked | {"out": str(out), "error": str(error)}), file=server.stdin, flush=True)
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess([module, *options], code, out.read_text(), error.read_text())


def jobs_of(*args: Any, **named: Any) -> list[jobs.Job]:
    """`benchmarks.jobs.jobs_of` with a Snakemake that has its imports done."""
    return jobs.jobs_of(*args, **named, start=run)


@cache
def _server() -> subprocess.Popen[str]:
    """The process whose forks the programs are."""
    started = subprocess.Popen(
        [sys.executable, "-m", "tests.workflow.prepared"],
        cwd=jobs.REPOSITORY,
        env=os.environ | {"PYTHONPATH": str(jobs.REPOSITORY)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(started.communicate)  # which ends its standard input, and so the process
    return started


def serve() -> None:
    """Fork once for each line of standard input, and answer with the exit code."""
    for name in IMPORTED:
        import_module(name)
    import_module("snakemake.cli").get_argument_parser()  # loads Snakemake's plugins
    import_module("fipt.config.methods").known_methods()  # reads the cards of methods, which are kept
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            _be(**json.loads(line))
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _be(module: str, options: list[str], folder: str, environment: dict[str, str], out: str, error: str) -> NoReturn:
    """Be a program from here on."""
    signal.alarm(LONGEST)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, path in ((1, out), (2, error)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), number)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *options]
    name, _, function = PROGRAMS[module].partition(":")
    sys.exit(getattr(import_module(name), function)())


if __name__ == "__main__":
    serve()
