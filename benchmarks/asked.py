"""What the jobs of finished rooms asked for, against the memory and time that they used: a line for each rule.

    python -m benchmarks.asked results/ROOM [results/OTHER ...]

Both are read from the workflow's own records, results/ROOM/benchmarks/. A job asks for the memory of its processes and
of those of the workflow; it should use at most nine tenths of the first, and at least a third. Jobs that were copied,
since the loop had settled, use next to nothing and are left out. Times are bounds for a queue: what comes near them is
marked. The exit code is 1 where a job used more than it may.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from fipt.config.resources import WORKFLOW
from fipt.errors import FiptError

MOST, LEAST = 0.9, 1 / 3
"""Shares of what was asked for between which the largest job of a rule should lie."""


@dataclass(frozen=True)
class JobUsage:
    """What one job asked for and used: memory in megabytes, time in minutes."""

    rule: str
    asked_mb: float
    used_mb: float
    asked_minutes: float
    used_minutes: float

    @property
    def share(self) -> float:
        """Share of the memory that was used."""
        return self.used_mb / self.asked_mb


def read_usage(results: Path) -> list[JobUsage]:
    """Every job of a room that computed something.

    Raises
    ------
    FiptError
        If there are no records.
    """
    found = []
    for path in sorted((results / "benchmarks").glob("*.jsonl")):
        stats = results / "stats" / f"{path.stem}.json"
        if stats.is_file() and json.loads(stats.read_text(encoding="utf-8")).get("copied"):
            continue
        *_, last = path.read_text(encoding="utf-8").splitlines() or [""]
        record = json.loads(last or "{}")
        asked = record.get("resources", {})
        if {"mem_mb", "runtime"} <= asked.keys() and isinstance(record.get("max_rss"), float):
            memory = asked["mem_mb"] - WORKFLOW, record["max_rss"]
            found.append(JobUsage(record["rule_name"], *memory, asked["runtime"], record["s"] / 60))
    if not found:
        raise FiptError(f"{results} holds no records of jobs in benchmarks/", "name the results of a room that ran")
    return found


def table(jobs: Iterable[JobUsage]) -> list[str]:
    """Lines of text: of every rule its number of jobs, and the job that used the largest share of its memory."""
    by_rule: dict[str, list[JobUsage]] = {}
    for job in jobs:
        by_rule.setdefault(job.rule, []).append(job)
    lines = [f"{'rule':18} {'jobs':>4} {'asked MB':>9} {'used MB':>8} {'share':>6} {'asked min':>10} {'used min':>9}"]
    for rule, own in by_rule.items():
        most, longest = max(own, key=lambda job: job.share), max(own, key=lambda job: job.used_minutes)
        lines.append(
            f"{rule:18} {len(own):4} {most.asked_mb:9.0f} {most.used_mb:8.0f} {most.share:6.2f} "
            f"{longest.asked_minutes:10.0f} {longest.used_minutes:9.1f}{_judged(most, longest)}"
        )
    return lines


def _judged(most: JobUsage, longest: JobUsage) -> str:
    """What is wrong with what a rule asks for; empty where nothing is."""
    wrong = ["  too little memory"] if most.share > MOST else ["  much memory"] if most.share < LEAST else []
    return ",".join([*wrong, *(["  too little time"] if longest.used_minutes > MOST * longest.asked_minutes else [])])


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 where a job used more than it may."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("results", nargs="+", type=Path, help="results/ROOM of rooms that ran")
    jobs = [job for results in parser.parse_args(arguments).results for job in read_usage(results)]
    print("\n".join(table(jobs)))
    return int(any(job.share > MOST or job.used_minutes > MOST * job.asked_minutes for job in jobs))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except FiptError as error:
        sys.exit(f"benchmarks.asked: {error}")
