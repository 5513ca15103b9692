"""A working directory in which the real Snakefile runs, with the real ``fipt`` or a stand-in.

The stand-in writes at once what a verb promises; its files hold the options, so that other settings
give other content. Which jobs are planned, and with which command lines, needs no numerics.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from benchmarks.jobs import REPOSITORY, WORKFLOW, Job, jobs_of

STAND_IN = '''#!{python}
"""Writes what a verb of fipt promises; notes its command line in calls.jsonl."""
import json, os, sys, time
from pathlib import Path

verb, rest = sys.argv[1], sys.argv[2:]
named = [i for i, text in enumerate(rest) if text.startswith("--") and text != "--reject"]
flags = {{rest[i]: rest[i + 1] for i in named}}
with open("calls.jsonl", "a") as file:
    file.write(json.dumps(sys.argv[1:]) + "\\n")

def write(path, what=""):
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    told = [flags.get(flag) for flag in ("--settings", "--setup", "--decisions")]
    Path(path).write_text(f"{{what}} {{verb}} {{told}}\\n")

if verb in ("synthesize-room", "import"):
    for name in ("transforms.json", "views.json", "mesh.ply", "room.json"):
        write(Path(flags["--dataset"], name), name)
if verb == "pose":
    for name in ("transforms.json", "views.json", "poses.json", "points.ply", "poses.png"):
        write(Path(flags["--out"], name), name)
elif verb in ("samples", "bake", "refine", "review"):
    write(Path(flags["--out"], "part.npy"))
    if verb == os.environ.get("SLEEP"):
        Path("sleeping.pid").write_text(str(os.getpid()))
        time.sleep(60)
    write(flags["--out"] + ".manifest.json")
elif verb == "fuse":
    write(Path(flags["--segments"], "fused.manifest.json"))
elif "--manifest" in flags:
    write(flags["--manifest"])
elif verb == "check-poses":
    write(Path(rest[0], "check_poses.json"))
elif "--out" in flags:
    write(flags["--out"])
    if verb == "emitters":
        write(flags["--out"].replace(".npz", ".json"))
    if verb == "fit":
        write(Path(flags["--out"]).with_name("confidence.npz"))
write(flags["--stats"])
'''


class Workspace:
    """A working directory with its own config."""

    def __init__(self, root: Path, config: dict[str, Any], stand_in: bool) -> None:
        self.root = root
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
        """The command line of Snakemake with the real Snakefile and the local profile."""
        profile = WORKFLOW / "profiles" / "local"
        return [
            *(sys.executable, "-m", "snakemake", "--snakefile", str(WORKFLOW / "Snakefile")),
            *("--workflow-profile", str(profile), "--cores", "2", *options),
        ]

    def snakemake(self, *options: str, succeeds: bool = True) -> str:
        """Run Snakemake here and return what it says."""
        done = subprocess.run(
            self.command(*options),
            cwd=self.root,
            env=self.environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=600,
        )
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
        return jobs_of(self.root, target=target)

    def fipt_run(self, *options: str, code: int = 0) -> str:
        """Call ``fipt run room`` here and return what it says on standard error."""
        command = [sys.executable, "-m", "fipt.cli.main", "run", "room", *options]
        done = subprocess.run(command, cwd=self.root, env=self.environment, text=True, capture_output=True, timeout=900)
        assert done.returncode == code, done.stderr + self.logs()
        return done.stderr

    def calls(self) -> list[list[str]]:
        """Command lines that the stand-in has seen."""
        lines = (self.root / "calls.jsonl").read_text().splitlines()
        return [json.loads(line) for line in lines]

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
