"""The command line as a whole: help, version, exit codes."""

import inspect
import os
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Annotated

import pytest
import typer

from fipt import __version__, registry
from fipt.cli import main as cli
from fipt.cli import verbs
from fipt.errors import FiptError


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch):
    """Replace the table by one verb, ``try``, whose command the test gives."""

    def install(command) -> None:
        module = SimpleNamespace(command=command)
        table = {"try": registry.Verb("A verb of this test.", "fipt.cli.try_")}
        for user in (cli, verbs):
            monkeypatch.setattr(user, "VERBS", table)
        monkeypatch.setitem(sys.modules, "fipt.cli.try_", module)

    return install


def test_help_lists_every_verb_in_under_half_a_second() -> None:
    times = []
    for _ in range(3):
        start = time.perf_counter()
        run = subprocess.run(
            [sys.executable, "-m", "fipt.cli.main", "--help"],
            capture_output=True,
            text=True,
            check=True,
        )
        times.append(time.perf_counter() - start)
    for name, entry in registry.VERBS.items():
        assert f"  {name} " in run.stdout
        assert entry.help in run.stdout
    assert min(times) < 0.5


def test_help_fits_a_terminal() -> None:
    assert max(map(len, cli.help_text().splitlines())) <= 100


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_version(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([option]) == 0
    assert capsys.readouterr().out == f"fipt {__version__}\n"


def test_matrices_have_one_thread_where_nobody_asks_for_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_WAIT_POLICY", "ACTIVE")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    cli.main(["--version"])
    assert (os.environ["OMP_WAIT_POLICY"], os.environ["OPENBLAS_NUM_THREADS"]) == ("ACTIVE", "1")


def test_no_verb_prints_the_help_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "Usage: fipt" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("bakke", "fipt: error: no such verb 'bakke'; did you mean 'bake'?\n"),
        ("xyzzy", "fipt: error: no such verb 'xyzzy'; 'fipt --help' lists the verbs\n"),
        ("--xyzzy", "fipt: error: no such option '--xyzzy'; 'fipt --help' lists the verbs\n"),
    ],
)
def test_unknown_verb(name: str, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name]) == 2
    assert capsys.readouterr().err == line


def test_fipt_error_is_one_line_and_exit_2(verb, capsys: pytest.CaptureFixture[str]) -> None:
    def command() -> None:
        raise FiptError("the mesh has 3 vertices with NaN", "repair it")

    verb(command)
    assert cli.main(["try"]) == 2
    captured = capsys.readouterr()
    assert captured.err == "fipt: error: the mesh has 3 vertices with NaN; repair it\n"
    assert captured.out == ""


def test_arguments_and_exit_codes(verb, capsys: pytest.CaptureFixture[str]) -> None:
    def command(count: Annotated[int, typer.Option(min=1)]) -> None:
        """Print a number."""
        print(count)
        raise typer.Exit(0 if count < 5 else 1)

    verb(command)
    assert cli.main(["try", "--count", "3"]) == 0
    assert capsys.readouterr().out == "3\n"
    assert cli.main(["try", "--count", "7"]) == 1
    assert cli.main(["try"]) == 2
    assert "--count" in capsys.readouterr().err
    assert cli.main(["try", "--count", "0"]) == 2
    assert cli.main(["try", "--number", "1"]) == 2
    assert cli.main(["try", "--help"]) == 0
    assert "Usage: fipt try" in capsys.readouterr().out


def test_interrupt_is_130(verb, capsys: pytest.CaptureFixture[str]) -> None:
    def command() -> None:
        raise KeyboardInterrupt

    verb(command)
    assert cli.main(["try"]) == 130


def test_anything_else_keeps_its_traceback(verb) -> None:
    def command() -> None:
        secret = "a local variable"  # noqa: F841 - must not show up in the traceback
        raise ZeroDivisionError("our own mistake")

    verb(command)
    with pytest.raises(ZeroDivisionError, match="our own mistake"):
        cli.main(["try"])


@pytest.mark.parametrize("name", registry.VERBS)
def test_every_verb_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert inspect.getdoc(verbs.command_of(name)), "its docstring is the help of the verb"
    assert cli.main([name, "--help"]) == 0
    assert f"Usage: fipt {name}" in capsys.readouterr().out
