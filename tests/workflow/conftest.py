"""A working directory in which the real Snakefile runs, with the real ``fipt`` or a stand-in.

The stand-in writes at once what a verb promises; its files hold the options, so that other settings
give other content. Which jobs are planned, and with which command lines, needs no numerics.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from benchmarks.jobs import REPOSITORY, WORKFLOW, Job
from tests.workflow import prepared

STAND_IN = '''#!{python} -S
"""Writes what a verb of fipt promises; notes its command line in calls.txt. It imports little: hundreds are started."""
import os, sys

verb, rest = sys.argv[1], sys.argv[2:]
flags = dict(zip(rest, rest[1:]))
with open("calls.txt", "a") as file:
    file.write("\\0".join(sys.argv[1:]) + "\\n")

# Snakemake's log says what the rule promises; a name without an ending is a folder.
logs = ""
for name in sorted(os.listdir(".snakemake/log")):
    with open(f".snakemake/log/{{name}}") as file:
        logs += file.read()
promised = [line.split(": ")[1].split(", ") for line in logs.splitlines() if line.startswith("    output: ")]
outputs = [files for files in promised if flags["--stats"] in files][-1]
told = [flags.get(flag) for flag in ("--settings", "--setup", "--decisions")]
for number, path in enumerate(outputs):
    if number == 1 and verb == os.environ.get("SLEEP"):
        import time

        with open("sleeping.pid", "w") as file:
            file.write(str(os.getpid()))
        time.sleep(60)
    if "." not in os.path.basename(path):
        path = os.path.join(path, "part.npy")
    os.makedirs(os.path.dirname(path), exist_ok=True)
    content = f"{{os.path.basename(path)}} {{verb}} {{told}}"
    if os.path.basename(path) == "findings.json":  # what `fipt run` reads
        import json

        content = json.dumps({{"findings": [], "told": told}})
    with open(path, "w") as file:
        file.write(content + "\\n")
'''


class Workspace:
    """A working directory with its own config."""

    def __init__(self, root: Path, config: dict[str, Any], stand_in: bool) -> None:
        self.root = root
        self.run = prepared.run
        self.environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
        self.configure(config)
        if stand_in:
            fipt = root / "bin" / "fipt"
            fipt.parent.mkdir()
            fipt.write_text(STAND_IN.format(python=sys.executable))
            fipt.chmod(0o755)
            self.environment["PATH"] = f"{fipt.parent}{os.pathsep}{os.environ['PATH']}"

    def configure(self, config: dict[str, Any]) -> None:
        """Write config/config.yaml."""
        path = self.root / "config" / "config.yaml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(yaml.safe_dump(config))
        (self.root / "night.exr").write_text("an environment map that a light setup may name")

    def command(self, *options: str) -> list[str]:
        """The command line of Snakemake with the real Snakefile and the local profile, after ``python -m``."""
        profile = WORKFLOW / "profiles" / "local"
        return [
            *("snakemake", "--snakefile", str(WORKFLOW / "Snakefile")),
            *("--workflow-profile", str(profile), "--cores", "2", *options),
        ]

    def snakemake(self, *options: str, succeeds: bool = True) -> str:
        """Run Snakemake here and return what it says."""
        module, *rest = self.command(*options)
        done = self.run(module, rest, self.root, self.environment, True)
        assert (done.returncode == 0) is succeeds, done.stdout + self.logs()
        return done.stdout

    def planned(self, *options: str) -> dict[str, int]:
        """Rule -> jobs that a run would do now; target rules left out."""
        text = self.snakemake(*options, "--dry-run", "--quiet", "rules")
        if "Nothing to be done" in text:
            return {}
        table = text[text.index("Job stats:") :].split("\n\n")[0]
        jobs = {name: int(n) for name, n in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}
        return {name: n for name, n in jobs.items() if name not in ("total", "all")}

    def jobs(self, target: str = "report") -> list[Job]:
        """Every job of the config, done or not."""
        return prepared.jobs_of(self.root, target=target)

    def fipt_run(self, *options: str, code: int = 0, scene: str = "room") -> str:
        """Call ``fipt run`` of a scene here and return what it says on standard error."""
        done = self.run("fipt.cli.main", ["run", scene, *options], self.root, self.environment)
        assert done.returncode == code, done.stderr + self.logs()
        return done.stderr

    def calls(self) -> list[list[str]]:
        """Command lines that the stand-in has seen."""
        return [line.split("\0") for line in (self.root / "calls.txt").read_text().splitlines()]

    def logs(self) -> str:
        """Every log of the results, for the message of a failed test."""
        logs = sorted(self.root.glob("results/*/logs/*.log"))
        return "\n".join(f"--- {log.name}\n{log.read_text()[-3000:]}" for log in logs)


@pytest.fixture
def workspace(tmp_path: Path) -> Callable[..., Workspace]:
    """A function that makes the working directory of a config."""

    def make(config: dict[str, Any], *, stand_in: bool = True) -> Workspace:
        return Workspace(tmp_path, config, stand_in)

    return make
