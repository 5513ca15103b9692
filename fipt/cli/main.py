"""Entry point of the command line: ``fipt VERB [OPTIONS]``.

The verbs stand in the table `fipt.registry.VERBS`. The module of a verb is imported only when the verb is called, so
that ``fipt --help`` answers at once and ``fipt doctor`` works even where a heavy package is broken. `fipt.cli.verbs`
derives the command of a stage from its ``run(inputs, settings)``.

Exit codes: 0 done, 1 a check of ``fipt doctor`` failed, 2 wrong usage or a `fipt.errors.FiptError`
(one line on stderr), or a crash of a library, 130 interrupted, 143 terminated. Anything else keeps its traceback.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fipt import __version__
from fipt.cli.guard import guarded
from fipt.cli.process import configure_logging, end_with_parent, is_job, leave, set_thread_defaults
from fipt.errors import EXIT_CODE, FiptError, shortage, unloadable
from fipt.registry import VERBS

_INTERRUPTED = 128 + signal.SIGINT


def help_text() -> str:
    """Return the text of ``fipt --help``, built without importing any verb."""
    width = max(map(len, VERBS))
    lines = [
        "Usage: fipt [--help | --version] VERB [OPTIONS]",
        "",
        "Inverse path tracing of rooms: from posed HDR images to materials, lamps, relit views.",
        "",
        "Verbs, in the order of the pipeline:",
        *(f"  {name:<{width}}  {verb.help}" for name, verb in VERBS.items()),
        "",
        "'fipt VERB --help' explains one verb.",
    ]
    return "\n".join(lines)


def program() -> None:
    """Be the program ``fipt``: run the command line and end with its exit code."""
    # An interruption as an exception is lost in libraries: pydantic takes it for a schema that is wrong. So what is not
    # watched ends at once, in the handler of `fipt.cli`; `fipt run` has one of its own while jobs run.
    job = is_job()
    if job:
        end_with_parent(os.getppid())
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    watched = name in VERBS and VERBS[name].section is not None and hasattr(os, "fork")
    code = guarded(name, main) if watched else main()
    leave(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; default: those of this process.

    Returns
    -------
    int
        The exit code, see the module's docstring. `SystemExit` is never raised.

    Raises
    ------
    Exception
        Whatever a verb raises that is not anticipated.
    """
    configure_logging()
    set_thread_defaults()
    args = list(sys.argv[1:] if argv is None else argv)
    try:
        Path.cwd()
    except FileNotFoundError:
        return _fail("the working directory is gone; change to one that exists")
    try:
        return _dispatch(args)
    except FiptError as error:
        return _fail(str(error))
    except KeyboardInterrupt:
        print("fipt: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except (ImportError, MemoryError, OSError, RuntimeError) as error:
        found = unloadable(error) if isinstance(error, ImportError) else shortage(error)
        if found is None:
            raise
        return _fail(str(found))


def _dispatch(args: list[str]) -> int:
    if not args:
        print(help_text(), file=sys.stderr)
        return EXIT_CODE
    name, rest = args[0], args[1:]
    if name in ("-h", "--help"):
        print(help_text())
        return 0
    if name in ("-V", "--version"):
        print(f"fipt {__version__}")
        return 0
    if name not in VERBS:
        return _fail(_unknown(name))
    from fipt.cli.verbs import command_of

    return run_command(command_of(name), rest, prog_name=f"fipt {name}")


def run_command(command: Callable[..., Any], args: Sequence[str], prog_name: str) -> int:
    """Parse `args` for one typer-annotated function, call it and return the exit code.

    Parameters
    ----------
    command : callable
        Function with typer annotations.
    args : sequence of str
        The verb's own arguments.
    prog_name : str
        Name shown in usage messages, such as ``fipt bake``.
    """
    import typer

    # Plain help and errors: they can be searched and pasted, and a long line stays one line.
    # typer's own tracebacks are off, since they print local variables (whole arrays).
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(command)
    try:
        app(args=list(args), prog_name=prog_name)
    except SystemExit as stop:
        return _exit_code(stop)
    return 0


def _exit_code(stop: SystemExit) -> int:
    if stop.code is None:
        return 0
    if stop.code == _INTERRUPTED:  # typer makes an exit without a word of it
        print("fipt: interrupted", file=sys.stderr)
    if isinstance(stop.code, int):
        return stop.code
    print(stop.code, file=sys.stderr)  # sys.exit("text") means: print it, fail
    return 1


def _unknown(name: str) -> str:
    from difflib import get_close_matches

    kind = "option" if name.startswith("-") else "verb"
    close = get_close_matches(name, VERBS, n=1)
    hint = f"did you mean '{close[0]}'?" if close else "'fipt --help' lists the verbs"
    return f"no such {kind} '{name}'; {hint}"


def _fail(message: str) -> int:
    print(f"fipt: error: {message}", file=sys.stderr)
    return EXIT_CODE


if __name__ == "__main__":
    program()
