"""What plans of many rooms cost: processor time and memory of dry runs, a line for each.

    python -m benchmarks.plans [ROOMS] [--done]

ROOMS (1,000) rooms of the demo stand in a sheet, and nothing is made yet: a plan of all of them, and one of a single
room by name. With ``--done``, a plan of all where nothing is left to do: outputs are empty files, of which Snakemake
writes its records (a quarter of an hour for 100 rooms).
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.jobs import REPOSITORY, WORKFLOW, jobs_of

SNAKEMAKE = ["snakemake", "--snakefile", str(WORKFLOW / "Snakefile")]


def used(module: Sequence[str], folder: Path) -> tuple[float, float]:
    """Seconds of processors and megabytes of memory that ``python -m MODULE OPTIONS`` takes in a folder."""
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen([sys.executable, "-m", *module], cwd=folder, env=environment, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)  # fmt: skip
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, module
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e6


def write_rooms(folder: Path, rooms: int) -> list[str]:
    """Write a configuration of rooms in code; return their names."""
    names = [f"room-{number:04d}" for number in range(rooms)]
    (folder / "config").mkdir(parents=True)
    (folder / "config" / "config.yaml").write_text("scenes: rooms.tsv\n")
    lines = ["name\tsource\tpreset", *(f"{name}\tprocedural\tdemo" for name in names)]
    (folder / "rooms.tsv").write_text("\n".join(lines) + "\n")
    return names


def finish(folder: Path) -> None:
    """Make an empty file of every output, and let Snakemake record all as made."""
    for path in (folder / output for job in jobs_of(folder) for output in job.outputs):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch() if path.suffix else path.mkdir(exist_ok=True)
    used([*SNAKEMAKE, "--touch", "--forceall", "--cores", "1"], folder)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="What plans of many rooms cost.")
    parser.add_argument("rooms", nargs="?", type=int, default=1000, help="how many")
    parser.add_argument("--done", action="store_true", help="nothing is left to do")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rooms = write_rooms(folder, given.rooms)
        plans = {f"all of {len(rooms)}": [*SNAKEMAKE, "--dry-run", "--quiet"]}
        if given.done:
            finish(folder)
        else:
            plans[f"one of {len(rooms)}"] = ["fipt.cli.main", "run", rooms[-1], "--dry-run"]
        for label, module in plans.items():
            seconds, megabytes = used(module, folder)
            print(f"{label}: {seconds:.1f} s, {megabytes:.0f} MB", flush=True)


if __name__ == "__main__":
    main()
