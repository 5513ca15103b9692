"""Which jobs are planned, and which run again; with a stand-in for ``fipt``."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from fipt.config import load
from fipt.errors import FiptError
from fipt.formats.files import total_memory
from tests.workflow.planned import CONFIG, FIRST, SETUP, SHOWN, changed, only

REPOSITORY = Path(__file__).resolve().parents[2]


def test_plans_everything_on_a_fresh_clone(workspace):
    config = yaml.safe_load((REPOSITORY / "config" / "config.yaml").read_text())
    here = workspace(config)
    jobs = here.planned()
    assert (jobs["fit"], jobs["refine"], jobs["bake"]) == (5, 4, 1)
    assert "results/demo/round-4/model.safetensors" in here.snakemake("--dry-run")


def test_plans_the_example_of_an_imported_scene(workspace):
    here = workspace(CONFIG)
    data = here.root / "data" / "dataset"
    frame = {"transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
    for split, count in (("train", 3), ("val", 1)):
        (data / split / "Image").mkdir(parents=True)
        frames = [{**frame, "file_path": f"{i:03d}"} for i in range(count)]
        cameras = {"camera_angle_x": 1.0, "w": 4, "h": 3, "frames": frames}
        (data / split / "transforms.json").write_text(json.dumps(cameras))
        for i in range(count):
            (data / split / "Image" / f"{i:03d}_0001.exr").touch()
    (data / "scene.obj").touch()
    example = str(REPOSITORY / "config" / "examples" / "living_room.yaml")
    options = ("--configfile", example, "--config", "only=[living_room]")
    jobs = here.planned(*options, f"data_root={here.root / 'data'}")
    assert jobs["import_dataset"] == 1
    assert "synthesize_room" not in jobs
    assert jobs["bake"] == 2

    text = here.snakemake("--dry-run", *options, succeeds=False)
    assert "scenes.living_room.path" in text
    assert "--config data_root=FOLDER" in text
    assert "Traceback" not in text
    # A scene that nobody asked for needs no data.
    assert "import_dataset" not in here.planned("--configfile", example, "--config", "only=room")


def test_runs_once_then_only_what_changed(workspace):
    here = workspace(CONFIG)
    assert here.planned() == FIRST
    here.snakemake()
    assert here.planned() == {}

    after_fit = {"fit": 2, "emitters": 1, "refine": 2, **only(*SHOWN)}
    after_bake = {**after_fit, "emitters": 2}
    expected = {
        "report": only("scene_report"),
        "metrics": only("scene_metrics", "scene_report"),
        "findings": only("findings", "scene_report"),
        "relight": only("relight_views", "scene_metrics", "scene_report"),
        "olat": only("olat_views", "scene_report"),
        "render": only("render_views", "scene_metrics", "scene_report"),
        "materials": only("material_maps", "scene_metrics", "scene_report"),
        "refine": {"refine": 2, "fit": 1, "emitters": 1, **only(*SHOWN)},
        "fit": after_fit,
        "bake": {"bake": 2, **after_bake},
        "cache": {"cache": 1, "environment": 1, "bake": 2, **after_bake},
        "environment": {"environment": 1, "bake": 2, **after_bake},
    }
    values = {
        "report": {"width": 100},
        "metrics": {"fit_exposure": True},
        "findings": {"views": 2},
        "cache": {"resolution": 32},
        "environment": {"resolution": 8},
        "materials": {"average": False},
        "fit": {"steps": 7},
    }
    for stage, jobs in expected.items():
        here.configure(changed(**{stage: values.get(stage, {"seed": 7})}))
        assert here.planned() == jobs, stage

    # One more round keeps the rounds before it.
    here.configure(changed(rounds=2))
    assert here.planned() == {"refine": 2, "fit": 1, "emitters": 1, **only(*SHOWN)}
    # One more setup relights, and leaves the rest alone.
    here.configure(changed(setups={"dim": {"emitters": [{"scale": 0.5}]}}))
    assert here.planned() == {**only("synthesize_relit", "relight_views", "scene_metrics", "scene_report")}
    # Content counts, not the time of a small file.
    here.configure(CONFIG)
    (here.root / "results/room/samples/train-000.manifest.json").touch()
    assert here.planned() == {}
    # A higher stage version is a reason to run.
    patch = here.root / "patch"
    patch.mkdir()
    (patch / "sitecustomize.py").write_text("import fipt.registry as r; r.VERSIONS['render'] += 1")
    here.environment["PYTHONPATH"] += os.pathsep + str(patch)
    assert here.planned() == only("render_views", "scene_metrics", "scene_report")


def test_targets_stop_where_they_say(workspace):
    here = workspace(CONFIG)
    made = {
        "dataset": {"synthesize_views"},
        "shading": {"refine"},
        "relight": {"relight_views"},
        "metrics": {"scene_metrics"},
    }
    for target, last in made.items():
        jobs = here.planned(target).keys() - {target}
        assert last <= jobs
        later = {"dataset": {"samples"}, "shading": set(SHOWN), "metrics": {"scene_report"}}
        assert not jobs & later.get(target, set())
    assert "scene_report" in here.planned("results/room/report.html")


def test_only_restricts_the_scenes(workspace):
    two = changed(scenes={**CONFIG["scenes"], "other": {"source": "procedural"}})
    here = workspace(two)
    assert here.planned()["scene_report"] == 2
    for value in ("only=room", "only=[room]"):
        assert here.planned("--config", value) == FIRST


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            {"fit": {"stepz": 3}},
            "unknown key fit.stepz (did you mean steps?); allowed in fit: ",
        ),
        ({"fitt": {}}, "unknown key fitt (did you mean fit?)"),
        ({"samples": {"grid": 17}}, "samples.grid: input should be less than or equal to 16; found 17"),
        ({"rounds": -1}, "rounds: input should be greater than or equal to 0; found -1"),
        (
            {"scenes": {"room": {"source": "procedural", "preset": "fast"}}},
            "scenes.room.preset: there is no preset 'fast'; presets: best, default, demo, paper",
        ),
        (
            {"scenes": {"room": {"source": "procedural", "settings": {"fit": {"batsh": 1}}}}},
            "unknown key scenes.room.settings.fit.batsh (did you mean batch?)",
        ),
        ({"environment": {"mode": "given"}}, "scene room: environment.file is missing; mode: given needs file: "),
        ({"only": ["attic"]}, "only: there is no scene 'attic'; scenes: room"),
    ],
)
def test_refuses_a_wrong_config_before_anything_runs(workspace, keys, said):
    here = workspace(changed(**keys))
    text = here.snakemake(succeeds=False)
    assert any(said in line for line in text.splitlines())
    assert not (here.root / "results").exists()


def test_a_first_look_finds_what_setups_name(workspace, monkeypatch):
    here = workspace(CONFIG)
    (here.root / "night.exr").unlink()
    monkeypatch.chdir(here.root)
    with pytest.raises(FiptError, match=r"a file of setups\.evening is missing"):
        load(CONFIG).scenes["room"].check()


def test_what_setups_name_is_looked_for_though_all_is_done(workspace):
    """Snakemake takes an error of an input function for "nothing to do" where the output exists."""
    here = workspace(CONFIG)
    here.snakemake()
    walk = {"path": {"keyframes": ["train_000", "train_00"], "frames": 2}}
    wrong = {
        "objects": ({"objects": [{"file": "chair.obj", "position": [2, 1, 2]}]}, "chair.obj"),
        "walk": ({"cameras": walk}, "train_00"),
        "front": ({"reference": "photographs"}, "photographs"),
    }
    for name, (setup, said) in wrong.items():
        config = changed()
        config["scenes"]["room"]["setups"] = SETUP | {name: setup}
        here.configure(config)
        assert said in here.snakemake("--dry-run", succeeds=False)


def test_a_killed_run_is_completed_by_the_next(workspace):
    here = workspace(CONFIG)
    running = subprocess.Popen(
        [sys.executable, "-m", *here.command()],
        cwd=here.root,
        env=here.environment | {"SLEEP": "bake"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    asleep = here.root / "sleeping.pid"  # a job in the middle of its output
    end = time.monotonic() + 120
    while not (asleep.exists() and asleep.read_text()):
        assert time.monotonic() < end
        time.sleep(0.1)
    try:
        assert "another run works on scene room" in here.snakemake(succeeds=False)
    finally:
        for pid in (running.pid, int(asleep.read_text())):
            os.kill(pid, signal.SIGKILL)
        running.wait()

    assert here.planned()["bake"] == 2
    here.snakemake()
    assert here.planned() == {}


NOTING = """#!{python} -S
import os, sys, time
with open("running.txt", "a") as file:
    print("begins", os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"], file=file)
code = os.spawnv(os.P_WAIT, "{fipt}", ["{fipt}", *sys.argv[1:]])
time.sleep(0.2)
with open("running.txt", "a") as file:
    print("ends", file=file)
sys.exit(code)
"""
"""A program that calls the stand-in for ``fipt``, and notes when, and with how many threads for libraries."""


def test_two_jobs_run_at_a_time(workspace):
    here = workspace(CONFIG)
    fipt = here.root / "bin" / "fipt"
    stand_in = fipt.rename(fipt.with_name("stand-in"))
    fipt.write_text(NOTING.format(python=sys.executable, fipt=stand_in))
    fipt.chmod(0o755)
    here.environment["FIPT_BACKEND"] = "llvm"
    here.snakemake()
    running, counts, threads = 0, [], set()
    for line in (here.root / "running.txt").read_text().splitlines():
        running += 1 if line.startswith("begins") else -1
        counts.append(running)
        threads |= {tuple(line.split()[1:])} if running and line.startswith("begins") else set()
    assert running == 0
    assert max(counts) == 2
    assert threads == {("2", "1"), ("1", "1")}  # all processors, but for rules that ask for one; numpy has one


def test_jobs_ask_for_no_more_memory_than_the_machine_has(workspace):
    huge = {"train_views": 400, "val_views": 2, "width": 8000, "height": 6000}
    room = {"source": "procedural", "settings": {"synthesize": huge}}
    here = workspace(changed(scenes={"room": room}, views_per_shard=400))
    asked = [int(size) for size in re.findall(r"mem_mb=(\d+)", here.snakemake("--dry-run"))]
    assert max(asked) == total_memory() // 1_000_000
    assert min(asked) < max(asked)
