"""The jobs of a scene as Snakemake plans them, for tests and benchmarks that call the verbs themselves."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
WORKFLOW = REPOSITORY / "fipt" / "workflow"


@dataclass(frozen=True)
class Job:
    """One call of a verb: its rule, its name in logs/ and stats/, its command line, its files."""

    rule: str
    label: str
    verb: str
    options: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def run(self) -> int:
        """Call the verb in this process, which saves the start of an interpreter; its exit code."""
        from fipt.cli.main import main

        return main([self.verb, *self.options])


def started(
    module: str, options: Sequence[str], folder: Path, environment: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run ``python -m MODULE OPTIONS`` in a folder."""
    command = [sys.executable, "-m", module, *options]
    return subprocess.run(command, cwd=folder, env=environment, text=True, capture_output=True)


def jobs_of(
    folder: Path,
    config: Mapping[str, Any] | None = None,
    target: str = "report",
    workflow: Path = WORKFLOW,
    start: Callable[..., subprocess.CompletedProcess[str]] = started,
) -> list[Job]:
    """Every job that the target needs, done or not, in an order in which they can run.

    ``config`` lies on top of config/config.yaml in the folder, where there is one; ``start`` runs Snakemake.
    """
    options = ["--snakefile", str(workflow / "Snakefile"), "--workflow-profile", str(workflow / "profiles" / "local")]
    options += ["--cores", "2", "--dry-run", "--forceall"]
    if config is not None:
        (folder / "jobs.json").write_text(json.dumps(config))
        options += ["--configfile", "jobs.json"]
    done = start("snakemake", [*options, "--", target], folder, os.environ | {"PYTHONPATH": str(REPOSITORY)})
    assert done.returncode == 0, done.stdout + done.stderr
    blocks = re.findall(r"^rule (\w+):\n(.*?)^Shell command: (fipt [^\n]*)$", done.stdout, re.MULTILINE | re.DOTALL)
    return [_job(rule, about, command) for rule, about, command in blocks]


def _job(rule: str, about: str, command: str) -> Job:
    fields = {name: tuple(files.split(", ")) for name, files in re.findall(r"^    (\w+): (.*)$", about, re.MULTILINE)}
    program, verb, *rest = shlex.split(command)
    assert program == "fipt"
    label = Path(fields["log"][0]).stem
    return Job(rule, label, verb, tuple(rest[: rest.index(">")]), fields.get("input", ()), fields["output"])


def run_all(jobs: list[Job]) -> int:
    """Run jobs one by one until one fails; its exit code, or 0."""
    return next((code for code in (job.run() for job in jobs) if code), 0)
