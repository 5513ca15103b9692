"""Three tiny rooms on a cluster where things go wrong, and the same rooms on one machine: their results are the same.

    python -m tests.cluster [--target TARGET] [--rounds N] [--keep FOLDER]

While the rooms run on the cluster, a node dies with its jobs, a job is cancelled, and every first fit asks for less
memory than it needs. All of it must be made good, and every file but times and logs must have the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import yaml

from benchmarks.jobs import REPOSITORY, WORKFLOW

SCRIPT = Path(__file__).with_name("slurm.sh")
ROOMS = "name\tsource\tsettings.synthesize.seed\n" + "".join(f"room{k}\tprocedural\t{k}\n" for k in range(3))
CONFIG = {
    "scenes": "rooms.tsv",
    "views_per_shard": 2,
    "synthesize": {"train_views": 4, "val_views": 1, "width": 32, "height": 24, "spp": 8},
    "samples": {"grid": 2},
    "cache": {"resolution": 64},
    "bake": {"diffuse_spp": 8, "specular_spp": 4, "smooth_spp": 4},
    "refine": {"diffuse_spp": 8, "specular_spp": 4, "smooth_spp": 4},
    "fit": {"steps": 60, "batch": 512, "levels": 8, "table_log2": 14},
    "render": {"spp": 8},
}
TOO_LITTLE = "fit:mem_mb=60*20**(attempt-1)"
"""Memory of fits: 60 MB at first, 1,200 then."""
PASSING = re.compile(r"(logs|stats|benchmarks)/.*|\..*|report\.html|provenance\.json")
"""Files of times, and those that come and go."""


class Cluster:
    """The cluster of slurm.sh, with what the test does to it."""

    def __init__(self, folder: Path) -> None:
        self.environment = os.environ | {"CLUSTER": str(folder), "SLURM_CONF": str(folder / "slurm.conf")}
        self.environment["PATH"] = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
        self.done: list[str] = []

    def call(self, *words: str) -> None:
        """Call slurm.sh."""
        subprocess.run(["bash", str(SCRIPT), *words], env=self.environment, check=True)

    def running(self) -> list[tuple[str, str, str]]:
        """Number, node and rule of the jobs that run now."""
        command = ["squeue", "-h", "-t", "running", "-o", "%i|%N|%k"]
        text = subprocess.run(command, env=self.environment, text=True, capture_output=True).stdout
        return [tuple(line.split("|")) for line in text.splitlines() if line.count("|") == 2]

    def disturb(self, over: threading.Event) -> None:
        """Cancel the first job that traces samples; kill the first node that bakes, and bring it back."""
        while not over.wait(0.5) and len(self.done) < 2:
            for number, node, rule in self.running():
                if "samples" in rule and "cancelled" not in self.done:
                    subprocess.run(["scancel", number], env=self.environment, check=True)
                    self.done.append("cancelled")
                    print(f"cluster: job {number} ({rule}) is cancelled", flush=True)
                elif "bake" in rule and "killed" not in self.done:
                    self.call("kill", node)
                    self.done.append("killed")
                    print(f"cluster: {node} dies with job {number} ({rule})", flush=True)
                    time.sleep(5)
                    self.call("revive", node)


def run(folder: Path, profile: str, target: str, environment: dict[str, str], *options: str) -> str:
    """Run the rooms in a folder; what Snakemake says."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(WORKFLOW / "Snakefile")]
    command += ["--workflow-profile", str(WORKFLOW / "profiles" / profile), *options, "--", target]
    path = os.pathsep.join(filter(None, [str(REPOSITORY), environment.get("PYTHONPATH")]))
    own = environment | {"PYTHONPATH": path, "FIPT_BACKEND": "llvm", "FIPT_THREADS": "2"}
    log = folder / "snakemake.log"
    with log.open("w") as file:
        code = subprocess.run(command, cwd=folder, env=own, stdout=file, stderr=subprocess.STDOUT).returncode
    text = log.read_text()
    assert code == 0, text[-6000:]
    return text


def hashes(folder: Path) -> dict[str, str]:
    """Hash of every file of the results that is no time."""
    found = {}
    for path in sorted((folder / "results").rglob("*")):
        below = path.relative_to(folder / "results")
        if path.is_file() and not PASSING.fullmatch(below.as_posix().partition("/")[2]):
            found[str(below)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def main() -> None:
    """Run the rooms on both, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", default="report")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder to work in; default: a temporary one")
    args = parser.parse_args()
    root = (args.keep or Path(tempfile.mkdtemp(prefix="fipt-cluster-"))).resolve()
    for name in ("one", "many"):
        (root / name / "config").mkdir(parents=True, exist_ok=True)
        (root / name / "config" / "config.yaml").write_text(yaml.safe_dump(CONFIG | {"rounds": args.rounds}))
        (root / name / "rooms.tsv").write_text(ROOMS)
    cluster, over = Cluster(root / "slurm"), threading.Event()
    trouble = threading.Thread(target=cluster.disturb, args=(over,))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the daemons end with it
    begin = time.monotonic()
    try:
        cluster.call("start")
        trouble.start()
        options = ("--retries", "3", "--set-resources", TOO_LITTLE, "--latency-wait", "5")
        said = run(root / "many", "slurm", args.target, cluster.environment, *options)
    except subprocess.CalledProcessError as error:
        sys.exit(f"cluster: failed: {' '.join(map(str, error.cmd))}")
    finally:
        over.set()
        if trouble.ident is not None:
            trouble.join()
        cluster.call("stop")
    print(f"cluster: all rooms are done after {time.monotonic() - begin:.0f} s")
    tried = len(re.findall(r"Trying to restart job", said))
    print(f"cluster: {tried} jobs were tried again; done to it: {', '.join(cluster.done)}")
    run(root / "one", "local", args.target, dict(os.environ), "--cores", "2")
    one, many = hashes(root / "one"), hashes(root / "many")
    differ = sorted(name for name in one.keys() | many.keys() if one.get(name) != many.get(name))
    print(f"cluster: {len(one)} files, {len(differ)} differ from those of one machine {differ[:5]}")
    assert not differ
    assert len(cluster.done) == 2
    assert tried >= 4, "three fits with too little memory, and what was disturbed"


if __name__ == "__main__":
    main()
