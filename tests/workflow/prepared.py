"""Programs of the workflow as forks of one process that has imported them: most of a dry run's time is imports.

A fork has its own working directory, environment, output and exit code, as a program that is started has. Of the rest
of a dry run's time, half goes into reading the same rules again: a fork notes what Snakemake's parser made of a file,
and which regular expressions it compiled, for those after it.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import re
import runpy
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
    """Run ``python -m MODULE OPTIONS`` in a folder; standard error lies in standard output where it is ``merged``.

    Of folders in PYTHONPATH beside the repository, a fork runs ``sitecustomize.py`` as Python does when it starts.
    """
    first, *others = environment.get("PYTHONPATH", "").split(os.pathsep)
    patches = [Path(other, "sitecustomize.py") for other in others]
    if first != str(jobs.REPOSITORY) or not all(patch.is_file() for patch in patches):  # other modules than imported
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
            "patches": list(map(str, patches)),
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
    notes = tempfile.TemporaryDirectory()
    atexit.register(notes.cleanup)  # after what is registered later
    started = subprocess.Popen(
        [sys.executable, "-m", "tests.workflow.prepared", notes.name],
        cwd=jobs.REPOSITORY,
        env=os.environ | {"PYTHONPATH": str(jobs.REPOSITORY)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(started.communicate)  # which ends its standard input, and so the process
    return started


class Notes:
    """What forks leave to those after them: how files of rules read as Python, and patterns of file names.

    Parameters
    ----------
    folder
        Holds a file for each.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._parsed: dict[str, tuple[str, dict[int, int], int]] = {}
        self._known: set[str] = set()
        workflow, files = import_module("snakemake.workflow"), import_module("snakemake.io")
        self._parse, workflow.parse = workflow.parse, self.parse
        self._pattern, files.regex_from_filepattern = files.regex_from_filepattern, self.pattern

    def parse(self, path: Any, workflow: Any, linemap: dict[int, int], **named: Any) -> tuple[str, int]:
        """What Snakemake's parser makes of a file; of one with the same path and content it is known."""
        place = path.get_path_or_uri(secret_free=True)
        asked = json.dumps([place, Path(place).read_text(), named], sort_keys=True)
        name = hashlib.sha256(asked.encode()).hexdigest()
        if name not in self._parsed:
            code, count = self._parse(path, workflow, linemap, **named)
            self._note(f"{name}.json", json.dumps([code, list(linemap.items()), count]))
            return code, count
        code, lines, count = self._parsed[name]
        linemap |= lines
        return code, count

    def pattern(self, file: str) -> str:
        """The regular expression of a name with wildcards."""
        found = self._pattern(file)
        if found not in self._known:
            self._note(f"{hashlib.sha256(found.encode()).hexdigest()}.txt", found)
        return found

    def _note(self, name: str, text: str) -> None:
        """Write a note; half a one, should the fork be killed, is none."""
        half = self._folder / f"{name}.half"
        half.write_text(text)
        half.rename(self._folder / name)

    def learn(self) -> None:
        """Read what the last fork has noted."""
        for path in self._folder.iterdir():
            if path.suffix == ".json":
                code, lines, count = json.loads(path.read_text())
                self._parsed[path.stem] = code, dict(lines), count
            elif path.suffix == ".txt":
                self._known.add(path.read_text())
                re.compile(path.read_text())  # which keeps it
            path.unlink()


def serve(folder: str) -> None:
    """Fork once for each line of standard input, and answer with the exit code; forks leave notes in the folder."""
    for name in IMPORTED:
        import_module(name)
    import_module("snakemake.cli").get_argument_parser()  # loads Snakemake's plugins
    import_module("fipt.config.methods").known_methods()  # reads the cards of methods, which are kept
    notes = Notes(Path(folder))
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            _be(**json.loads(line))
        _, status = os.waitpid(pid, 0)
        notes.learn()
        print(os.waitstatus_to_exitcode(status), flush=True)


def _be(
    module: str, options: list[str], folder: str, environment: dict[str, str], patches: list[str], out: str, error: str
) -> NoReturn:
    """Be a program from here on."""
    signal.alarm(LONGEST)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, path in ((1, out), (2, error)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), number)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for patch in patches:
        runpy.run_path(patch)
    sys.argv = [module, *options]
    name, _, function = PROGRAMS[module].partition(":")
    sys.exit(getattr(import_module(name), function)())


if __name__ == "__main__":
    serve(sys.argv[1])
