"""``fipt doctor``: says whether the pipeline can run here."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from fipt import __version__, doctor

_MARKS = {"ok": "[green]ok[/]", "warning": "[yellow]warning[/]", "problem": "[red]problem[/]"}


def command(
    results: Annotated[Path, typer.Option(help="Folder of the results: its disk is checked.")] = Path("results"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Check Python, packages, ray tracing backend, denoiser, memory and disk.

    Each problem comes with its remedy. The exit code is 1 if the pipeline cannot run here.
    """
    checks = doctor.run_checks(results)
    can_run = all(check.status != "problem" for check in checks)
    if as_json:
        report = {
            "fipt": __version__,
            "can_run": can_run,
            "checks": [asdict(check) for check in checks],
        }
        print(json.dumps(report, indent=2))
    else:
        _print_table(checks)
        print("The pipeline can run here." if can_run else "The pipeline cannot run here.")
    raise typer.Exit(0 if can_run else 1)


def _print_table(checks: list[doctor.Check]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=f"fipt {__version__}", title_justify="left")
    table.add_column("check")
    table.add_column("status")
    # Found and remedy are written below each other: a remedy may be a command to be copied.
    table.add_column("found, and what to do about it", overflow="fold")
    for check in checks:
        text = escape(check.found)
        if check.remedy:
            text += f"\n[bold]-> {escape(check.remedy)}[/]"
        table.add_row(check.name, _MARKS[check.status], text)
    Console().print(table)
