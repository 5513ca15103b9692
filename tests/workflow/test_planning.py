"""Which jobs are planned, and which run again; with a stand-in for ``fipt``."""

import copy
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
import yaml

from fipt.config import load
from fipt.errors import FiptError
from tests import captures, modelled

REPOSITORY = Path(__file__).resolve().parents[2]
SETUP = {"evening": {"emitters": [{"scale": 0.0}], "environment": {"file": "night.exr"}}}
CONFIG = {
    "scenes": {
        "room": {
            "source": "procedural",
            "setups": SETUP,
            "settings": {"synthesize": {"train_views": 3, "val_views": 2}},
        }
    },
    "rounds": 1,
    "views_per_shard": 2,
}
"""Two train shards, one val shard, two rounds; a setup with an environment map."""

FIRST = {
    "synthesize_room": 1,
    "synthesize_views": 3,
    "synthesize_relit": 1,
    "check_poses": 1,
    "samples": 3,
    "environment": 1,
    "cache": 1,
    "bake": 2,
    "fit": 2,
    "emitters": 2,
    "refine": 2,
    "review": 1,
    "material_maps": 3,
    "render_views": 1,
    "relight_views": 1,
    "olat_views": 1,
    "scene_metrics": 1,
    "findings": 1,
    "scene_report": 1,
}


def changed(**keys):
    return {**copy.deepcopy(CONFIG), **keys}


def only(*rules):
    return {rule: FIRST[rule] for rule in rules}


SHOWN = (
    "review",
    "material_maps",
    "render_views",
    "relight_views",
    "olat_views",
    "scene_metrics",
    "findings",
    "scene_report",
)


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
        "cache": {"cache": 1, "bake": 2, **after_bake},
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


def test_segments_are_planned_alike(workspace, monkeypatch):
    """Given ids by view, then fused; or grown on the mesh."""
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)
    ids = here.root / "ids"
    ids.mkdir()
    for view in range(3):
        (ids / f"train_{view:03d}.png").write_text("ids")
    assert "fuse" not in here.planned()  # the dataset has ids

    given = changed(segment={"mode": "given", "path": str(ids)})
    here.configure(given)
    assert here.planned() == {**FIRST, "segment": 2, "fuse": 1}
    here.snakemake()
    jobs = here.jobs()
    fits = [job.options for job in jobs if job.verb == "fit"]
    assert all(options[options.index("--segments") + 1] == "results/room/segments/fused" for options in fits)
    for job in jobs:
        for path in (*job.inputs, *job.outputs):
            assert (here.root / path).exists(), path

    (ids / "train_002.png").write_text("other ids")
    # Both shards read the folder; with the same ids again, the rest stays (the stand-in writes what it is told).
    assert here.planned()["segment"] == 2
    here.configure(changed(segment={"mode": "geometry"}))
    after = here.planned()
    assert "segment" not in after
    assert (after["fuse"], after["fit"]) == (1, 2)
    grown = here.jobs()
    assert [job.options[4:5] for job in grown if job.verb == "fuse"] == [("--geometry",)]
    assert "--geometry" in here.snakemake("--dry-run", "--printshellcmds")

    here.configure(changed(segment={"mode": "none"}))
    assert "fuse" not in here.planned()
    assert '"segments": "none"' in here.snakemake("--dry-run", "--printshellcmds")


def test_setups_with_objects_and_segments_are_planned_alike(workspace, monkeypatch):
    """Their files are inputs; fused ids too, where a setup names some, and there is no truth of that."""
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)
    config = changed(segment={"mode": "geometry"})
    config["scenes"]["room"]["setups"] = {
        "guest": {"objects": [{"file": "chair.obj", "position": [2, 1, 2]}]},
        "bare": {"remove": [{"at": [2, 0, 2]}]},
    }
    (here.root / "chair.obj").write_text("mtllib chair.mtl\n")
    (here.root / "chair.mtl").write_text("newmtl wood\n")
    here.configure(config)
    planned = here.planned()
    assert (planned["relight_views"], planned["synthesize_relit"]) == (2, 1)
    here.snakemake()
    jobs = here.jobs()
    (bare,) = [job for job in jobs if job.label.startswith("relight.bare")]
    assert bare.options[bare.options.index("--segments") + 1] == "results/room/segments/fusion.npz"
    (here.root / "chair.mtl").write_text("newmtl oak\n")
    after = here.planned()
    assert (after["relight_views"], after["synthesize_relit"]) == (1, 1)
    assert "fit" not in after


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


def test_the_export_is_planned_alike(workspace, monkeypatch):
    """With every run where it is enabled, by its target otherwise; other settings rerun it and the page."""
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)
    assert here.planned("export").keys() >= {"export_room", "check_export", "render_views"}
    enabled = changed(export={"enabled": True})
    here.configure(enabled)
    assert here.planned() == {**FIRST, "export_room": 1, "check_export": 1}
    here.snakemake()
    assert here.planned() == {}
    jobs = here.jobs()
    for job in jobs:
        assert (here.root / "results/room/stats" / f"{job.label}.json").is_file()
        for path in (*job.inputs, *job.outputs):
            assert (here.root / path).exists()
    here.configure(changed(export={"enabled": True, "samples": 3}))
    assert here.planned() == {"export_room": 1, "check_export": 1, "scene_report": 1}


def filmed(**path):
    """A setup with three free cameras, a path of five frames, and a setup with photographs of the two views."""
    look_at = {name: {"position": [1, 1, 1], "target": [2, 1, 1]} for name in ("desk", "door", "sofa")}
    keyframes = ["train_000", {"position": [1, 1, 1], "target": [2, 1, 1]}, "val_001"]
    setups = {
        "still": {"cameras": {"look_at": look_at}},
        "walk": {"cameras": {"path": {"keyframes": keyframes, "frames": 5, **path}}},
        "front": {"reference": "photos"},
    }
    return changed(scenes={"room": {**CONFIG["scenes"]["room"], "setups": setups}})


def test_own_cameras_and_references_are_planned_alike(workspace, monkeypatch):
    """Pictures of free cameras shard by shard, then joined; photographs are compared by the metrics."""
    here = workspace(CONFIG)
    (here.root / "photos").mkdir()
    (here.root / "photos" / "val_001.exr").write_text("a photograph")
    config = filmed()
    here.configure(config)
    # the views once, and two and three shards of free cameras; only views have a truth
    assert here.planned() == {**FIRST, "relight_views": 1 + 2 + 3, "join_images": 2}
    here.snakemake()
    assert here.planned() == {}
    monkeypatch.chdir(here.root)
    jobs = here.jobs()
    for job in jobs:
        assert (here.root / "results/room/stats" / f"{job.label}.json").is_file()
        for path in (*job.inputs, *job.outputs):
            assert (here.root / path).exists(), path
    frames = [job.options[job.options.index("--cameras") + 1] for job in jobs if job.label.startswith("relight.walk")]
    assert sorted(frames) == ["frame-0001,frame-0002", "frame-0003,frame-0004", "frame-0005"]

    # What places cameras and exposes their pictures is an input of both.
    for job in jobs:
        if job.label.startswith(("relight.walk", "video")):
            assert {"results/room/dataset/check_poses.json", "results/room/dataset/views.json"} <= set(job.inputs)
    assert {job.options[job.options.index("--max-views") + 1] for job in jobs if job.verb == "video"} == {"12"}
    here.configure({**config, "report": {"max_views": 3}})
    assert here.planned() == {"join_images": 2, "scene_report": 1}

    # Another rate needs no other pictures; another keyframe needs all of that path.
    here.configure(filmed(fps=10, video="png"))
    assert here.planned() == {"join_images": 1, "scene_report": 1}
    here.configure(filmed(loop=True))
    assert here.planned() == {"relight_views": 3, "join_images": 1, "scene_report": 1}
    # A setup that is no more leaves the page, one that loses its cameras is seen by views and scored.
    fewer = filmed()
    del fewer["scenes"]["room"]["setups"]["still"]
    here.configure(fewer)
    assert here.planned() == only("scene_report")
    fewer["scenes"]["room"]["setups"]["walk"] = {}
    here.configure(fewer)
    assert here.planned() == only("synthesize_relit", "relight_views", "scene_metrics", "scene_report")
    here.configure(config)
    (here.root / "photos" / "val_001.exr").write_text("another photograph")
    assert here.planned() == only("scene_metrics", "scene_report")


def test_own_cameras_and_references_that_cannot_be(workspace, monkeypatch):
    here = workspace(CONFIG)
    (here.root / "photos").mkdir()
    monkeypatch.chdir(here.root)
    (here.root / "photos" / "other.exr").touch()
    here.configure(filmed())
    said = here.snakemake("--dry-run", succeeds=False)
    assert "reference photos must hold photographs named as the relit views; none of val_000.exr, val_001.exr" in said
    with pytest.raises(FiptError, match="reference photos must hold photographs"):
        load(filmed()).scenes["room"].check()
    (here.root / "photos" / "val_000.hdr").touch()
    here.configure(filmed(keyframes=["train_000", "val_009"]))
    said = here.snakemake("--dry-run", succeeds=False)
    assert "goes through view 'val_009', which there is not; use val_00" in said


def photographed(root):
    """A capture of two views with calibration frames, their poses, a mesh, and its config."""
    made = captures.write(root / "photos", views=3, size=(32, 24), scale=2, calibration_frames=1)
    (root / "photos" / "transforms.json").rename(root / "poses.json")
    (root / "mesh.ply").touch()
    assert made.folder.is_dir()
    entry = {"source": "raw", "path": "photos", "poses": "poses.json", "mesh": "mesh.ply"}
    return {**CONFIG, "scenes": {"room": entry}}


def simulated(_):
    scene = {**CONFIG["scenes"]["room"]}
    return {**CONFIG, "scenes": {"room": scene | {"simulate_raw": True}}}


def estimated(root):
    """Photographs whose poses are estimated and brought to known positions."""
    config = photographed(root)
    config["scenes"]["room"]["poses"] = "colmap"
    return {**config, "poses": {"align": {"reference": "poses.json"}}}


def simulated_and_estimated(root):
    config = simulated(root)
    config["scenes"]["room"]["poses"] = "colmap"
    return {**config, "poses": {"align": {"reference": "results/room/room/transforms.json"}}}


@pytest.mark.parametrize("config_of", [photographed, simulated, estimated, simulated_and_estimated])
def test_photographs_are_planned_alike(workspace, monkeypatch, config_of):
    """Another bracket or other settings rerun what follows."""
    here = workspace(CONFIG)
    config = config_of(here.root)
    here.configure(config)
    first = here.planned()
    assert (first["calibrate"], first["qa"], first["import_dataset"]) == (1, 1, 1)
    assert first["develop"] == first["samples"]
    here.snakemake()
    assert here.planned() == {}
    monkeypatch.chdir(here.root)
    jobs = here.jobs()
    for job in jobs:
        for path in (*job.inputs, *job.outputs):
            assert (here.root / path).exists(), path
    assert ("pose" in {job.verb for job in jobs}) is (config["scenes"]["room"].get("poses") == "colmap")

    here.configure({**config, "capture": {"saturation": 0.9}})
    again = here.planned()
    assert {"calibrate", "develop", "qa", "import_dataset", "fit", "scene_report"} <= again.keys()
    assert not again.keys() & {"photograph_views", "photographed_room"}
    if config_of is photographed:
        here.configure(config)
        path = here.root / "photos" / "DSC00006.dng"  # of the held-out view, alone in its shard
        path.write_bytes(path.read_bytes()[:-1])
        again = here.planned()
        assert again["develop"] == 1
        assert "calibrate" not in again


@pytest.mark.parametrize("simulate", [False, True])
def test_scene_files_are_planned_alike(workspace, monkeypatch, simulate):
    """A texture that changes makes the room's views anew."""
    here = workspace(CONFIG)
    modelled.write_scene(here.root / "scene")
    entry = CONFIG["scenes"]["room"] | {"source": "mitsuba", "path": "scene/room.xml", "simulate_raw": simulate}
    config = {**CONFIG, "scenes": {"room": entry}}
    here.configure(config)
    first = here.planned()
    expected = {"photographed_room": 1, "photograph_views": 3, "synthesize_truth": 3, "import_dataset": 1}
    assert first["synthesize_relit"] == 1
    assert {rule: first.get(rule, 0) for rule in expected} == (expected if simulate else dict.fromkeys(expected, 0))
    assert (first.get("synthesize_room", 0), first.get("synthesize_views", 0)) == ((0, 0) if simulate else (1, 3))
    here.snakemake()
    assert here.planned() == {}
    monkeypatch.chdir(here.root)
    jobs = here.jobs()
    files = {"scene/room.xml", "scene/models/cupboard.obj", "scene/textures/tiles.png"}
    rooms = [job for job in jobs if "--scene" in job.options]
    assert len(rooms) == (8 if simulate else 5)
    for job in rooms:
        assert files <= set(job.inputs)

    (here.root / "scene/textures/tiles.png").write_bytes(b"another picture")
    again = here.planned()
    views = {"photograph_views", "synthesize_truth"} if simulate else {"synthesize_views"}
    assert {*views, "synthesize_relit", "fit", "scene_report"} <= again.keys()


def test_poses_must_be_of_the_photographs(workspace, tmp_path):
    here = workspace(CONFIG)
    config = photographed(here.root)
    poses = here.root / "poses.json"
    poses.write_text(poses.read_text().replace("train_", "other_").replace("val_", "other2_"))
    here.configure(config)
    said = here.snakemake("--dry-run", succeeds=False)
    assert "must have poses of the views in photos; it has other_000" in said
    config["scenes"]["room"].pop("poses")
    here.configure(config)
    said = here.snakemake("--dry-run", succeeds=False)
    assert "scenes.room.poses is missing; source: raw needs poses" in said


def test_a_killed_run_is_completed_by_the_next(workspace):
    here = workspace(CONFIG)
    running = subprocess.Popen(
        here.command(),
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
