"""What kinds of rooms plan: segments, exports, cameras, photographs, scene files; with a stand-in for ``fipt``."""

import pytest

from fipt.config import load
from fipt.errors import FiptError
from tests import captures, modelled
from tests.workflow.planned import CONFIG, FIRST, changed, only

pytestmark = pytest.mark.slow


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
    assert (after["fuse"], after["regroup"], after["fit"]) == (1, 2, 2)
    grown = here.jobs()
    fits = [job.options for job in grown if job.verb == "fit"]
    assert [options[options.index("--segments") + 1] for options in fits] == [
        "results/room/round-0/segments",
        "results/room/round-1/segments",
    ]
    assert [job.options[4:5] for job in grown if job.verb == "fuse"] == [("--geometry",)]
    assert "--geometry" in here.snakemake("--dry-run", "--printshellcmds")

    here.configure(changed(segment={"mode": "geometry"}, regroup={"ids": "none"}))
    assert "regroup" not in here.planned()
    here.configure(changed(regroup={"ids": "all"}))
    assert here.planned()["regroup"] == 2
    here.configure(changed(regroup={"ids": "all"}, fit={"segments": "semantic"}))
    assert "regroup" not in here.planned()

    here.configure(changed(segment={"mode": "none"}, regroup={"ids": "all"}))
    assert {"fuse", "regroup"}.isdisjoint(here.planned())
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


def test_the_page_is_told_what_the_plan_makes(workspace, monkeypatch):
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)

    def told(config):
        here.configure(config)
        (page,) = [job for job in here.jobs() if job.verb == "report"]
        return {option for option in page.options if option.startswith(("--olat-shards", "--sections"))}

    assert told(changed(export={"enabled": True})) == {"--olat-shards=val-000", "--sections=export"}
    assert told(changed(olat={"views": 0})) == {"--olat-shards=", "--sections="}


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
    assert "must have poses of the photographed views, train_000" in said
    config["scenes"]["room"].pop("poses")
    here.configure(config)
    said = here.snakemake("--dry-run", succeeds=False)
    assert "scenes.room.poses is missing; source: raw needs poses" in said
