"""Every verb reads only what its rule lists, and writes only what its rule declares: seen, not claimed.

Each job of small rooms runs while the system notes which files of results/ it opens. A manifest stands for the files
that it lists, a folder for all below it.
"""

import json
import os
import re
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.jobs import WORKFLOW, Job
from fipt.formats.arrays import save_npz
from fipt.formats.images import write_png
from fipt.stages.geometry.library import tried
from tests.opened import opened
from tests.unit.stages.geometry.test_depth import camera
from tests.unit.stages.geometry.test_stage import write_dataset
from tests.workflow.prepared import jobs_of

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="inotify tells which files are opened: Linux only"),
]

UNLISTED = {
    "review": r"emitters_review\.yaml",  # people write there; what they decide reaches jobs as parameters
    "estimate_poses": r"poses/work/.*",  # features and matches, kept for the next estimate
    "scene_report": r"stats/.*",  # times and memory, which are no reason to write the page again
}
"""Files that a rule's verb may read and write though the rule does not name them, as regular expressions."""

COMPARED = re.compile(r"results/room/(methods/[\w.-]+/)?(dataset|geometry/views)/[\w.-]+\.manifest\.json")
"""Manifests of datasets: hashes in them say whether content is what was written. Content itself must be listed."""

SMALL = {"diffuse_spp": 4, "specular_spp": 2, "smooth_spp": 2, "denoise": False}
CONFIG = {
    "rounds": 1,
    "views_per_shard": 2,
    "synthesize": {"train_views": 3, "val_views": 1, "width": 32, "height": 24, "spp": 4, "denoise": False},
    "samples": {"grid": 1},
    "check_poses": {"enabled": True},
    "cache": {"resolution": 32},
    "bake": SMALL,
    "refine": SMALL | {"max_depth": 3},
    "fit": {"steps": 20, "batch": 128, "levels": 4, "table_log2": 10},
    "render": {"spp": 4},
    "relight": {"spp": 4},
    "olat": {"spp": 4},
    "findings": {"views": 1, "width": 16, "spp": 4, "pixels": 1000},
    "export": {"enabled": True, "samples": 1, "max_resolution": 1024},
}
ROOM = {
    "source": "procedural",
    "setups": {
        "dim": {"emitters": [{"scale": 0.4}]},
        "bare": {"remove": [{"at": [2, 0, 2]}]},
        "walk": {"cameras": {"path": {"keyframes": ["train_000", "val_000"], "frames": 2}}},
    },
}
PHOTOGRAPHED = {
    "source": "procedural",
    "simulate_raw": True,
    "setups": {"dim": {"emitters": [{"scale": 0.4}]}},
    "settings": {
        "synthesize": {"raw": {"scale": 4, "calibration_frames": 9}},
        "capture": {"downscale": 4, "board_square": 0.03},
    },
}
JUDGED = {
    "scenes": {"room": PHOTOGRAPHED},
    "rounds": 0,
    "views_per_shard": 4,
    "synthesize": {"train_views": 4, "val_views": 1, "width": 32, "height": 24, "spp": 32},
    "samples": {"grid": 2},
    "cache": {"resolution": 48},
    "bake": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4},
    "fit": {"steps": 150, "batch": 512, "levels": 8, "table_log2": 14},
    "export": {},
}
"""Enough of everything for materials that can be judged."""

KD_PSNR = 12.0
"""dB on training views of the photographed room, linear: measured 15.4 when this was written."""


def wrong(job: Job, known: dict[str, tuple[str, ...]]) -> list[str]:
    """Run a job; what it read or wrote that its rule does not say, each with the rule's name."""
    root = Path("results/room")
    for path in (*job.inputs, *job.outputs):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    with opened(root) as seen:
        code = job.run()
    # estimated poses need sharper pictures than these; the verb has read all by then
    failed = [] if code == (2 if job.rule == "estimate_poses" else 0) else [f"{job.label} failed"]
    known[job.rule] = job.outputs
    own = {f"{root}/logs/{job.label}.log", f"{root}/benchmarks/{job.label}.jsonl"}
    read = undeclared(seen.read, [*job.inputs, *job.outputs, *own])
    read = [path for path in read if not COMPARED.fullmatch(str(path))]
    written = undeclared(seen.written, [*job.outputs, *own])
    found = [f"rule {job.rule} does not list {path}, which `fipt {job.verb}` reads" for path in read]
    found += [f"rule {job.rule} does not declare {path}, which `fipt {job.verb}` writes" for path in written]
    free = re.compile(f".* {root}/{UNLISTED.get(job.rule, '(?!)')}, which .*")
    return failed + [line for line in found if not free.fullmatch(line)]


def undeclared(paths: Iterable[Path], declared: Iterable[str]) -> list[Path]:
    """Paths that are neither declared, nor below a declared folder, nor in a declared manifest."""
    files, folders = set(), []
    for name in map(Path, declared):
        files.add(name)
        if name.is_dir():
            folders.append(name)
        elif name.name.endswith(".manifest.json") and name.exists():
            files |= {name.parent / listed for listed in json.loads(name.read_text())["files"]}
    return sorted(p for p in paths if p not in files and not any(folder in p.parents for folder in folders))


def traced(config: dict, target: str = "report") -> tuple[list[str], set[str]]:
    """What is wrong with the jobs of a config, and the rules that ran."""
    known: dict[str, tuple[str, ...]] = {}
    found = [line for job in jobs_of(Path(), config, target) for line in wrong(job, known)]
    return found, set(known)


RULES: set[str] = set()
"""Those that the tests have traced so far."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("results/room").mkdir(parents=True)
    return tmp_path


def test_a_room_in_code_with_given_ids(folder):
    """Its own ids are not used, so that views are segmented and fused."""
    (folder / "ids").mkdir()
    for view in range(3):
        write_png(
            folder / "ids" / f"train_{view:03d}.png", np.repeat([1, 2], 16 * 24).reshape(24, 32).astype(np.uint16)
        )
    config = CONFIG | {"scenes": {"room": ROOM}, "segment": {"mode": "given", "path": "ids"}}
    config["regroup"] = {"ids": "fused"}
    config["emitters"] = {"guess": False}  # takes half a minute here; the other room has it, in round 0
    found, rules = traced(config)
    RULES.update(rules)
    assert not found, "\n".join(found)

    for view in range(3):
        save_npz(f"{view:06d}.npz", diffuse=np.full((24, 32, 3), 0.5), roughness=np.ones((24, 32)))
    others = {"label": "Others", "kind": "imported", "estimator": "imported", "source": "a file"}
    methods = ["irradiance", "bound-constants", "ipt-reimpl", "texture-prb", "converged", "others"]
    compared = config | {"compare": {"methods": methods, "seeds": 1, "sensitivity": ["exposure-25"]}}
    compared["inverse_trace"] = {"steps": 2, "pixels": 16, "spp": 1}
    compared["methods"] = {"others": others | {"settings": {"import_results": {"path": ".", "layout": "npz"}}}}
    for target in ("compare", "results/compare/page.html"):
        jobs = [job for job in jobs_of(Path(), compared, target) if not all(map(os.path.exists, job.outputs))]
        found = [line for job in jobs for line in wrong(job, {})]
        RULES.update(job.rule for job in jobs)
        assert not found, "\n".join(found)
    page = Path("results/room/compare.html").read_text()
    assert "Radiance over irradiance" in page
    assert json.loads(Path("results/room/compare/table.json").read_text())["methods"][0]["id"] == "fipt"

    # an input that is deleted from a rule on purpose is noticed, with the rule's name and the file's
    changed = folder / "changed"
    shutil.copytree(WORKFLOW, changed)
    rules_file = changed / "rules" / "samples.smk"
    line = '        mesh=own("results/{scene}/dataset/mesh.ply"),\n'
    assert line in rules_file.read_text()
    rules_file.write_text(rules_file.read_text().replace(line, ""))
    jobs = jobs_of(folder, config, "results/room/samples/val-000.manifest.json", changed)
    (job,) = [job for job in jobs if job.rule == "samples"]
    assert wrong(job, {}) == ["rule samples does not list results/room/dataset/mesh.ply, which `fipt samples` reads"]


def test_a_room_that_is_photographed(folder):
    """By a simulated camera: from RAW brackets to materials."""
    found, rules = traced(CONFIG | JUDGED)
    RULES.update(rules)
    assert not found, "\n".join(found)

    judged = json.loads(Path("results/room/capture/qa.json").read_text())
    assert all(state["accepted"] for state in judged["views"].values())
    assert not [finding for finding in judged["findings"] if finding["severity"] == "error"]
    figures = json.loads(Path("results/room/metrics.json").read_text())["train"]
    assert figures["kd_psnr"] > KD_PSNR
    assert figures["emission_iou"] > 0.8
    # lamps have the room's own radiance: the simulated camera states its unit
    assert figures["log_radiance_error"] < 0.1
    assert 'id="capture"' in Path("results/room/report.html").read_text()

    config = CONFIG | JUDGED | {"scenes": {"room": PHOTOGRAPHED | {"poses": "colmap"}}}
    (job,) = [job for job in jobs_of(folder, config) if job.rule == "estimate_poses"]
    assert wrong(job, {}) == []
    RULES.add("estimate_poses")


def test_a_room_whose_mesh_is_made_of_its_views(folder, open3d):
    write_dataset(folder / "views", [camera(f"v{i}", 0.15 * i, 0.1 * (i % 2)) for i in range(5)])
    (folder / "views" / "views.json").unlink()  # of this program's layout
    entry = {"source": "dataset", "path": "views", "format": "nerfstudio"}
    found, rules = traced(CONFIG | {"scenes": {"room": entry}}, "results/room/dataset/mesh.ply")
    RULES.update(rules)
    assert not found, "\n".join(found)
    assert {"import_views", "depth", "first_mesh", "check_views", "mesh", "import_dataset"} <= rules


def test_every_rule_was_traced():
    """Runs last; it needs the others."""
    files = (WORKFLOW / "rules").glob("*.smk")
    rules = {name for file in files for name in re.findall(r"^rule (\w+):", file.read_text(), re.MULTILINE)}
    targets = set(re.findall(r"^rule (\w+):", (WORKFLOW / "rules" / "targets.smk").read_text(), re.MULTILINE))
    if not RULES:
        pytest.skip("run with the other tests of this file")
    unseen = set() if tried()[0] else {"import_views", "depth", "first_mesh", "check_views", "mesh"}
    assert rules - targets - RULES == unseen
