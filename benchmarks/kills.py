"""A run of a tiny room that is stopped at random moments, again and again, until it is done: words, codes and results.

    python -m benchmarks.kills [--moments 30] [--seed 0] [--out docs]

SIGINT, SIGTERM and SIGKILL take turns. Each run goes on where the one before was stopped. When it is done, its results
are compared with those of a run that nobody stopped, byte for byte, except for what tells times: logs, stats, report.
All runs use a copy of the package: if it changed meanwhile, a job would end with a traceback.
"""

import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.jobs import REPOSITORY

CONFIG = {
    "scenes": {"room": {"source": "procedural", "setups": {"dim": {"emitters": [{"scale": 0.4}]}}}},
    "rounds": 1,
    "synthesize": {"train_views": 4, "val_views": 1, "width": 32, "height": 24, "spp": 8},
    "samples": {"grid": 2},
    "cache": {"resolution": 32},
    "bake": {"diffuse_spp": 64, "specular_spp": 16, "smooth_spp": 16},
    "refine": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4},
    "fit": {"steps": 120, "batch": 256, "levels": 4, "table_log2": 10, "checkpoint_every": 20},
    "render": {"spp": 4},
    "relight": {"spp": 4},
}
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
_TIMES = re.compile(r"(logs|stats|benchmarks)/|report\.html|provenance\.json|\.lock")
"""Files that say when and how long."""


@dataclass(frozen=True)
class Stop:
    """How a run ended that was stopped.

    Attributes
    ----------
    number
        Name of the signal.
    seconds
        After the run's start.
    code
        Exit code; negative: the number of the signal that ended it.
    ended_in
        Seconds from the signal to the end of the run.
    words
        The last line on standard error.
    traceback
        Whether there was one.
    left
        Processes of the run that were alive two seconds after its end.
    """

    number: str
    seconds: float
    code: int
    ended_in: float
    words: str
    traceback: bool
    left: int


def start(folder: Path) -> "subprocess.Popen[str]":
    """Start ``fipt run`` in a folder, in a group of processes of its own."""
    (folder / "config").mkdir(parents=True, exist_ok=True)
    (folder / "config" / "config.yaml").write_text(json.dumps(CONFIG))
    environment = os.environ | {"PYTHONPATH": str(folder.parent / "code"), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "fipt.cli.main", "run", "room", "--cores", "2"]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=(folder / "stderr").open("w"), text=True
    )


def stopped(folder: Path, number: signal.Signals, seconds: float) -> Stop | int:
    """Run for some seconds, then send the signal; the exit code where the run ended before."""
    running = start(folder)
    try:
        return running.wait(seconds)
    except subprocess.TimeoutExpired:
        pass
    begin = time.monotonic()
    running.send_signal(number)
    code = running.wait(120)
    took = time.monotonic() - begin
    words = (folder / "stderr").read_text()
    time.sleep(2)
    last = words.strip().splitlines()[-1] if words.strip() else ""
    return Stop(number.name, round(seconds, 2), code, round(took, 2), last, "Traceback" in words, alive(folder))


def alive(folder: Path) -> int:
    """Processes that work in a folder (Linux)."""
    count = 0
    for place in Path("/proc").glob("[0-9]*/cwd"):
        try:
            count += place.resolve(strict=True) == folder.resolve()
        except OSError:
            continue
    return count


def results(folder: Path) -> dict[str, str]:
    """Path -> hash of every result that does not tell times."""
    root = folder / "results" / "room"
    files = (path for path in root.rglob("*") if path.is_file())
    names = {str(path.relative_to(root)): path for path in files}
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in sorted(names.items())
        if not _TIMES.match(name)
    }


def measure(folder: Path, moments: int, seed: int) -> dict[str, object]:
    """Stop runs at so many moments; begin again with an empty folder whenever one is done."""
    shutil.copytree(REPOSITORY / "fipt", folder / "code" / "fipt")
    begin = time.monotonic()
    assert start(folder / "whole").wait() == 0, (folder / "whole" / "stderr").read_text()
    length = time.monotonic() - begin
    expected = results(folder / "whole")
    say(f"undisturbed: {length:.0f} s, {len(expected)} files")
    chance, stops, compared, attempt = random.Random(seed), [], [], 0
    while True:
        number = SIGNALS[len(stops) % len(SIGNALS)]
        place = folder / f"stopped-{attempt}"
        # late enough that the next run gets somewhere, early enough that some are stopped while libraries load
        wait = chance.uniform(0.5, length / 10) if len(stops) < moments else 600.0
        found = stopped(place, number, wait)
        if isinstance(found, Stop):
            stops.append(found)
            say(f"{len(stops)}: {found}")
            continue
        own = results(place)
        different = sorted(name for name in own.keys() | expected.keys() if own.get(name) != expected.get(name))
        compared.append({"code": found, "stops": len(stops), "different": different})
        say(f"done with code {found} after {len(stops)} stops: {len(different)} of {len(expected)} files differ")
        if found:
            say((place / "stderr").read_text())
        attempt += 1
        if len(stops) >= moments or found:
            break
    return {
        "seconds": round(length, 1),
        "files": len(expected),
        "seed": seed,
        "runs": compared,
        "stops": [asdict(stop) for stop in stops],
    }


def say(text: str) -> None:
    """Write a line to standard error."""
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Measure, and print a line for each stop."""
    parser = argparse.ArgumentParser("python -m benchmarks.kills", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--moments", type=int, default=30, help="how many signals are sent")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--out", type=Path, help="folder of kills.json")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fipt-kills-") as folder:
        found = measure(Path(folder), arguments.moments, arguments.seed)
    if arguments.out is not None:
        (arguments.out / "kills.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
