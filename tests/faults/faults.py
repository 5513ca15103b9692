"""A fault: how it is planted in a tiny source, what is called, and what must be said; see docs/robustness.md."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from fipt.cli.main import main


@dataclass(frozen=True)
class Fault:
    """A fault of somebody's input.

    Attributes
    ----------
    name
        What is wrong, as the name of the test.
    plant
        Makes the faulty input in the working directory.
    said
        Part of the line that must be said.
    """

    name: str
    plant: Callable[[], None]
    said: str


def named(faults: Sequence[Fault]) -> pytest.MarkDecorator:
    """Run a test for every fault of a table, by its name."""
    return pytest.mark.parametrize("fault", faults, ids=[fault.name for fault in faults])


def contents(folder: Path) -> dict[str, str]:
    """Path -> hash of every file below a folder, and where every link leads."""
    found = {}
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(place, name)
            if path.is_symlink():
                found[str(path)] = str(path.readlink())
            elif path.is_file():
                found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    """Call the command line; it must refuse with code 2 and one line, which is returned."""
    capsys.readouterr()
    code = main(list(argv))
    said = capsys.readouterr().err
    assert code == 2, said
    lines = [line for line in said.splitlines() if line.startswith("fipt: ")]
    assert len(lines) == 1, said
    assert lines[0].startswith("fipt: error: ")
    assert "Traceback" not in said
    return lines[0]
