"""What checks of inputs and of files between stages cost: seconds of processor time in a run of a small room.

    python -m benchmarks.checks [--width 64] [--views 8] [--rounds 1]

A room in code is written, imported again as a source that nobody knows, and taken through every stage to its report,
each verb in this process and under a profiler (which makes all of it slower alike). Counted is the time in the
functions of `CHECKS`, once where they call each other. What jobs check before they start, and the plan, are not in it.
"""

import argparse
import cProfile
import os
import pstats
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from benchmarks.jobs import Job, jobs_of, run_all

CHECKS = {
    "cameras: views against each other": ("check_poses/stage.py:_judged",),
    "files between stages: hashes, origins": ("formats/manifests.py:check", "formats/origins.py:check_origin",
                                              "model/store.py:_checksum"),
    "images of the source": ("importing/encoding.py:add", "importing/defects.py:add", "scene/dataset.py:check_image",
                             "formats/exr.py:check_marks", "formats/exr.py:_check_windows"),
    "mesh and scale of the source": ("importing/place.py:placed", "importing/place.py:scale_warnings",
                                     "importing/place.py:double_warnings", "importing/place.py:viewpoint_warnings",
                                     "meshing/mend.py:mended"),
    "networks against the search of parts": ("fit/reached.py:metallic_missed",),
    "light and objects that reach nothing, or fill one place": ("render/reach.py:unreached",
                                                                "render/crowding.py:crowded"),
    "settings, cameras, layers": ("validation.py:checked", "scene/cameras.py:check_cameras",
                                  "importing/frames.py:check_layer", "scene/environment.py:checked"),
    "memory and disk": ("formats/files.py:check_memory", "formats/files.py:check_disk"),
}  # fmt: skip
"""Class -> functions, by the end of their file."""


def spent(found: pstats.Stats) -> Counter[str]:
    """Seconds in each class of checks; of functions that other checks call, only what others called."""
    classes = {place: name for name, places in CHECKS.items() for place in places}

    def kind(function: tuple[str, int, str]) -> str | None:
        file, _, name = function
        return next((kind for place, kind in classes.items() if f"{file}:{name}".endswith(f"/{place}")), None)

    seconds: Counter[str] = Counter()
    for function, (_, _, _, _, callers) in found.stats.items():  # pyright: ignore[reportAttributeAccessIssue]
        if own := kind(function):
            seconds[own] += sum(row[3] for caller, row in callers.items() if kind(caller) is None)
    return seconds


def measured(jobs: Iterable[Job]) -> tuple[Counter[str], Counter[str]]:
    """Seconds of processor time of each verb, and in each class of checks."""
    verbs: Counter[str] = Counter()
    checks: Counter[str] = Counter()
    for job in jobs:
        profile = cProfile.Profile(time.process_time)
        begin = time.process_time()
        code = profile.runcall(job.run)
        verbs[job.verb] += time.process_time() - begin
        if code:
            raise SystemExit(f"{job.label} failed")
        checks += spent(pstats.Stats(profile))
    return verbs, checks


def config(width: int, views: int, rounds: int) -> dict[str, object]:
    """A room in code, and the same as a source."""
    few = {"diffuse_spp": 64, "specular_spp": 16, "smooth_spp": 16}
    setup = {"lights": [{"shape": "sphere", "center": [1, 2, 1], "radius": 0.1, "radiance": [5, 5, 5]}]}
    return {
        "scenes": {
            "known": {"source": "procedural"},
            "room": {"source": "dataset", "path": "results/known/dataset", "format": "fipt", "setups": {"lamp": setup}},
        },
        "rounds": rounds,
        "synthesize": {"train_views": views, "val_views": 2, "width": width, "height": width * 3 // 4, "spp": 64},
        "cache": {"resolution": 64},
        "bake": few,
        "refine": few,
        "fit": {"steps": 200, "batch": 512, "levels": 8, "table_log2": 14},
        "render": {"spp": 16},
        "relight": {"spp": 16},
    }


def main() -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.checks", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--width", type=int, default=64, help="of the images, pixels")
    parser.add_argument("--views", type=int, default=8, help="training views")
    parser.add_argument("--rounds", type=int, default=1, help="last round")
    arguments = parser.parse_args()
    from fipt.formats.files import write_text

    with tempfile.TemporaryDirectory(prefix="fipt-checks-") as folder:
        os.chdir(folder)
        write_text(Path("config/config.yaml"), "{}\n")
        settings = config(arguments.width, arguments.views, arguments.rounds)
        if run_all(jobs_of(Path(), {**settings, "only": ["known"]}, "dataset")):
            return 1
        jobs = jobs_of(Path(), {**settings, "only": ["room"]}, "report")
        verbs, checks = measured(jobs)
        os.chdir("/")
    total = verbs.total()
    print(f"{len(jobs)} jobs, {total:.1f} s of processor time, under a profiler", file=sys.stderr)
    for name, seconds in [*checks.most_common(), ("all checks", checks.total())]:
        print(f"| {name} | {seconds:.2f} s | {seconds / total:.2%} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
