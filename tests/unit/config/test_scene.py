"""What the rules ask of a scene."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from fipt.config import load
from fipt.config.kept import files_in_folders
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.stages.capture.brackets import Bracket, Capture, Finding
from fipt.stages.capture.raw import Shot
from fipt.stages.geometry import library
from tests.layouts import WRITERS

RULES = sorted((Path(__file__).resolve().parents[3] / "fipt" / "workflow" / "rules").glob("*.smk"))
SIZE = {"synthesize": {"train_views": 3, "val_views": 1}}
OWN_MESH = {"simulate_raw": True, "mesh": "reconstruct"}
LOOK_AT = {"look_at": {"door": {"position": [0, 0, 0], "target": [1, 0, 0]}}}


def scene(entry=None, **keys):
    room = {"source": "procedural", "settings": SIZE} | (entry or {})
    return load({"scenes": {"room": room}, "views_per_shard": 2, **keys}).scenes["room"]


def test_a_question_takes_the_wildcards_that_it_names():
    room = scene(setups={"night": {}, "walk": {"cameras": LOOK_AT}})
    answer = room.answer
    assert answer("source.known") is True
    assert answer("views.listed", scene="room", shard="train-001", setup="night") == "train_002"
    assert answer("settings_json", section="cache", scene="room") == '{"resolution": 256}'
    assert answer("setups.seen_options", setup="night", shard="val-000") == ["--views", "val_000"]
    assert answer("setups.seen_options", setup="walk", shard="camera-000") == ["--cameras", "door"]
    with pytest.raises(AttributeError):
        answer("source.colour")


def test_the_rules_ask_what_there_is():
    room, raw = scene(), scene({"source": "raw", "path": "p", "poses": "colmap", "mesh": "m", "settings": None})
    asked = {
        question for path in RULES for question in re.findall(r'(?:ask|listed|where)\("([\w.]+)"', path.read_text())
    }
    assert len(asked) > 20
    for question in asked:
        found = raw if question.startswith("source.photographs") else room
        for name in question.split("."):
            assert hasattr(type(found), name) or hasattr(found, name), question
            found = room.source if name == "source" and found is room else getattr(found, name)


def test_rules_files_have_few_functions():
    text = "".join(path.read_text() for path in RULES)
    assert len(re.findall(r"^ *def |lambda", text, re.MULTILINE)) <= 25


def test_images_of_every_kind_of_source():
    made = "results/room/dataset/images.{}.manifest.json"
    imported, truth = "results/room/dataset/images.manifest.json", "results/room/dataset/truth.{}.manifest.json"
    assert scene().images(["train"]) == [made.format("train-000"), made.format("train-001")]
    assert scene().images(["train"], shard="train-001") == [made.format("train-001")]
    simulated = scene({"simulate_raw": True})
    assert simulated.images(["val"]) == [imported, truth.format("val-000")]
    assert simulated.developed()[0] == "results/room/capture/qa.json"
    assert scene().developed() == scene().judged() == []


RAW = {"source": "raw", "path": "p", "poses": "p.json", "settings": None}
MADE = "results/room/geometry/mesh.ply"


@pytest.mark.parametrize(
    ("entry", "views"),
    [
        (RAW, ["p.json"]),
        (RAW | {"mesh": "reconstruct"}, ["p.json"]),
        (
            OWN_MESH,
            ["results/room/room/transforms.json", "results/room/room/room.json"],
        ),
    ],
    ids=["nothing said", "asked for", "simulated"],
)
def test_a_mesh_is_made_of_the_images_where_none_is_given(entry, views):
    source = scene(entry).source
    assert source.reconstructed
    assert MADE in source.imported_files()
    assert sorted(source.view_files()) == sorted(views)
    assert source.import_options()[source.import_options().index("--mesh") + 1] == MADE
    assert source.view_options()[source.view_options().index("--mesh") + 1] == "none"


def test_everything_that_an_import_reads_is_its_input(tmp_path):
    """Ids and truth of a layout, masks of frames, names: when one changes, it is imported again."""
    WRITERS["fipt-synthetic"](tmp_path / "s")
    (tmp_path / "s" / "meta.json").write_text("{}")
    entry = {"source": "dataset", "path": str(tmp_path / "s"), "format": "fipt-synthetic", "settings": None}
    listed = scene(entry).source.imported_files()
    known = [*(tmp_path / "s").rglob("IndexMA/*.exr"), *(tmp_path / "s").rglob("DiffCol/*.exr")]
    assert known
    assert {str(path) for path in [*known, tmp_path / "s" / "meta.json"]} <= set(listed)

    WRITERS["nerfstudio"](tmp_path / "n")
    (tmp_path / "n" / "mask.png").write_bytes(b"")
    content = json.loads((tmp_path / "n" / "transforms.json").read_text())
    content["frames"][0]["mask_path"] = "mask.png"
    (tmp_path / "n" / "transforms.json").write_text(json.dumps(content))
    entry |= {"path": str(tmp_path / "n"), "format": "nerfstudio"}
    assert str(tmp_path / "n" / "mask.png") in scene(entry).source.imported_files()


def test_what_lies_beside_poses_mesh_and_ids_is_read_by_an_import(tmp_path):
    """Verdicts on views, what is known of the room, names of ids."""
    beside = ["p/poses.json", "p/views.json", "p/room.json", "m/room.json", "ids/part.json", "ids/semantic.json"]
    for name in (*beside, "p/transforms.json", "ids/part/a.png", "ids/part/b.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    named = {"poses": "p/transforms.json", "mesh": "m/mesh.ply", "segments": "ids"}
    entry = RAW | {key: str(tmp_path / name) for key, name in named.items()}
    wanted = {str(tmp_path / name) for name in (*beside, "p/transforms.json", "m/mesh.ply", "ids/part/a.png")}
    assert set(scene(entry).source.imported_files()) == wanted
    listed = scene(entry | {"poses": "colmap"}).source.imported_files()
    assert str(tmp_path / "m/room.json") in listed
    assert len(listed) == len(set(listed))


def test_photographs_and_poses_of_a_capture_are_known_inputs(tmp_path):
    for name in ("b", "a"):
        write_exr(tmp_path / "photos" / f"{name}.exr", {"": np.ones((4, 4, 3), np.float32)})
    (tmp_path / "model").mkdir()
    for name in ("cameras.txt", "images.txt"):
        (tmp_path / "model" / name).touch()
    entry = RAW | {"path": str(tmp_path / "photos"), "poses": str(tmp_path / "model"), "mesh": str(tmp_path / "m.ply")}
    source = scene(entry).source
    poses = {str(tmp_path / "model" / name) for name in ("cameras.txt", "images.txt")}
    assert poses < set(source.imported_files())
    photographs = {str(tmp_path / "photos" / f"{name}.exr") for name in "ab"}
    assert set(source.given_files()) == photographs | poses | {str(tmp_path / "m.ply")}
    made = scene(entry | {"poses": "colmap", "mesh": "reconstruct"}).source
    assert set(made.given_files()) == photographs, "what is made here is nobody's input"


def bracket(view, kind, exposures=1):
    return Bracket(view, kind, tuple(Shot(Path(f"{view}{k}.{kind}"), shutter=0.5**k) for k in range(exposures)))


def calibrated_by(brackets, shards, findings=()):
    """Names of the photographs that a calibration depends on."""
    taken = scene(RAW).source.photographs
    taken.__dict__["_read"] = Capture(Path("p"), tuple(brackets), tuple(findings))
    return taken.calibration(shards)


def test_the_calibration_depends_on_the_shard_that_tells_the_camera():
    """The first view that can be used, not the first: that one may have another zoom."""
    brackets, zoomed = [bracket("a", "raw"), bracket("b", "raw")], [Finding("zoom", "error", "", "", ("a",))]
    assert calibrated_by(brackets, {"train-000": ["a"], "train-001": ["b"]}, zoomed) == ["b0.raw"]
    assert calibrated_by(brackets, {"train-000": ["a"]}, zoomed) == ["b0.raw"], "a view without a pose tells it, too"


def test_the_calibration_depends_on_the_shards_that_tell_the_response():
    """Of JPEG and PNG, three brackets of several exposures tell the curve."""
    views = [bracket("a", "ldr"), *(bracket(view, "ldr", 2) for view in "bcdef")]
    shards = {"train-000": ["a"], "train-001": ["b", "f"], "train-002": ["c", "d"], "train-003": ["e"]}
    read = calibrated_by(views, shards)
    assert read == ["a0.ldr", *(f"{view}{k}.ldr" for view in "bcdf" for k in (0, 1))]


def test_a_mesh_that_is_given_is_used(tmp_path):
    assert not scene(RAW | {"mesh": "m.ply"}).source.reconstructed
    assert not scene({"simulate_raw": True}).source.reconstructed
    with pytest.raises(FiptError, match="mesh of a known room may be reconstruct, where simulate_raw is true"):
        scene({"mesh": "reconstruct"})
    WRITERS["nerfstudio"](tmp_path)
    dataset = {"source": "dataset", "path": str(tmp_path), "format": "nerfstudio", "settings": None}
    assert not scene(dataset).source.reconstructed
    assert str(tmp_path / "mesh.ply") in scene(dataset).source.imported_files()
    asked = scene(dataset | {"mesh": "reconstruct"}).source
    assert asked.reconstructed
    assert not any(path.endswith(".ply") for path in asked.view_files())
    (tmp_path / "mesh.ply").unlink()
    assert scene(dataset).source.reconstructed


def test_depth_maps_that_a_layout_names_are_taken(tmp_path):
    WRITERS["nerfstudio"](tmp_path)
    entry = {"source": "dataset", "path": str(tmp_path), "format": "nerfstudio", "mesh": "reconstruct"}
    made = scene(entry | {"settings": None})
    assert made.given_depth() == made.depth_options() == []
    path = tmp_path / "transforms.json"
    content = json.loads(path.read_text())
    for number, frame in enumerate(content["frames"]):
        (tmp_path / f"depth_{number}.png").write_text("")
        frame["depth_file_path"] = f"depth_{number}.png"
    path.write_text(json.dumps(content))
    made = scene(entry | {"settings": None})
    assert len(made.given_depth()) == len(made.views.of("train"))
    assert made.depth_options() == ["--layout", str(tmp_path)]
    stereo = scene(entry | {"settings": {"depth": {"given": "none"}}})
    assert stereo.given_depth() == stereo.depth_options() == []
    training = made.views.of("train")
    (frame,) = [f for f in content["frames"] if Path(f["file_path"]).stem == training[0]]
    del frame["depth_file_path"]
    path.write_text(json.dumps(content))
    with pytest.raises(FiptError, match=f"{training[0]} does not"):
        scene(entry | {"settings": None}).given_depth()


def test_files_of_folders_that_jobs_read_are_inputs_of_a_run(tmp_path):
    """Photographs under a setup, ids and depth of the views; not what lies beside them."""
    names = ["evening/val_000.exr", "ids/part/train_000.png", "depth/train_000.exr", "depth/val_000.exr"]
    for name in (*names, "evening/notes.txt", "depth/train_001.exr", "depth/train_002.exr"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    settings = SIZE | {
        "segment": {"mode": "given", "path": str(tmp_path / "ids")},
        "depth": {"given": str(tmp_path / "depth")},
    }
    entry = {"settings": settings, "setups": {"evening": {"reference": str(tmp_path / "evening")}}}
    read = {str(tmp_path / name) for name in names[:2]}
    assert set(files_in_folders(scene(entry))) == read
    made = scene(entry | OWN_MESH)
    depth = {str(tmp_path / f"depth/train_{k:03d}.exr") for k in range(3)}
    assert set(files_in_folders(made)) == read | depth
    (tmp_path / "evening/val_000.exr").unlink()
    assert set(files_in_folders(made)) == {str(tmp_path / names[1])} | depth, "a run that ended well before it"


def test_a_scan_is_brought_to_the_cameras_where_a_mesh_is_made(tmp_path):
    settings = {"settings": {"geometry": {"scan": str(tmp_path / "scan.ply")}}}
    with pytest.raises(FiptError, match=r"settings.geometry.scan needs `mesh: reconstruct`"):
        scene(RAW | {"mesh": "m.ply"} | settings).check()
    made = scene(RAW | settings)
    with pytest.raises(FiptError, match=r"geometry.scan .*scan.ply"):
        made.given_scan()
    (tmp_path / "scan.ply").write_text("")
    assert made.given_scan() == [str(tmp_path / "scan.ply")]
    assert scene(RAW).given_scan() == []


def test_a_method_that_needs_depth_is_refused_without(tmp_path):
    (tmp_path / "scan.ply").write_text("")
    with pytest.raises(FiptError, match=r"settings.geometry.method depth needs depth maps or a scan; none are given"):
        scene(RAW | {"settings": {"geometry": {"method": "depth"}}}).check()
    with pytest.raises(FiptError, match=r"settings.geometry.prior needs `mesh: reconstruct`"):
        scene(RAW | {"mesh": "m.ply", "settings": {"geometry": {"method": "monosdf", "prior": "p"}}}).check()
    with pytest.raises(FiptError, match=r"settings.geometry.method needs `mesh: reconstruct`; the scene brings a mesh"):
        scene(RAW | {"mesh": "m.ply", "settings": {"geometry": {"method": "sdf"}}}).check()
    named = scene(RAW | {"settings": {"geometry": {"method": "depth", "scan": str(tmp_path / "scan.ply")}}})
    assert named.given_scan() == [str(tmp_path / "scan.ply")]
    assert named.given_prior() == []


def test_a_mesh_that_is_made_needs_open3d_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(library, "find_spec", lambda name: None)
    scene(RAW | {"mesh": "m.ply"}).check()
    made = scene(OWN_MESH)
    with pytest.raises(FiptError, match=r"open3d must be importable .*pip install 'fipt\[geometry\]'.*fipt doctor"):
        made.check()
    mesh = tmp_path / made.layout.estimated_mesh
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    made.check()  # it was made elsewhere


def test_jobs_are_not_told_what_only_plans_read():
    """Else they would run again: to export with every run, or to relight more views, makes no file of before anew."""
    for section, one, other in (
        ("export", {"enabled": True}, {}),
        ("relight", {"split": "all"}, {"split": "val"}),
        ("emitters", {"every_round": False}, {}),
        ("compare", {"methods": ["fipt"], "seeds": 2, "quick": True, "sensitivity": ["all"]}, {}),
    ):
        assert scene(**{section: one}).settings_json(section) == scene(**{section: other}).settings_json(section)


def test_poses_are_checked_where_they_may_be_wrong():
    assert not scene().checks_poses
    assert scene().images_to_check() == []
    estimated = scene({"simulate_raw": True, "poses": "colmap"})
    assert estimated.checks_poses
    assert json.loads(estimated.settings_json("check_poses"))["enabled"] is True
    assert scene(check_poses={"enabled": True}).images_to_check() == scene().images(["all"])


def test_depth_sees_the_full_images_and_what_concerns_smaller_ones_alone_does_not_import_them_again():
    full, small = (
        scene(OWN_MESH | {"settings": {"import": own}}).answer("source.view_settings")
        for own in ({"exposure": 2}, {"exposure": 2, "downscale": 4, "prepare": "never", "overlay": False})
    )
    assert full == small
    assert (json.loads(full)["exposure"], json.loads(full)["downscale"]) == (2, 1)


def test_a_mesh_of_the_full_images_has_triangles_for_the_smaller_ones():
    made = OWN_MESH | {"settings": {"import": {"downscale": 4}}}
    assert json.loads(scene(made).settings_json("geometry"))["triangle_size"] == 4
    assert json.loads(scene(made | {"settings": {}}).settings_json("geometry"))["triangle_size"] == 1


@pytest.mark.parametrize(
    ("own", "true"),
    [
        ({}, True),
        ({"simulate_raw": True}, True),
        ({"simulate_raw": True, "poses": "colmap"}, False),
        (OWN_MESH, False),
        (
            {"simulate_raw": True, "poses": "colmap", "settings": {"poses": {"align": {"reference": "known.json"}}}},
            True,
        ),
    ],
)
def test_setups_have_a_truth_in_the_room_s_own_coordinates_and_on_its_own_mesh(own, true):
    made = scene(own, setups={"dim": {}})
    assert made.setups.with_truth() == (["dim"] if true else [])


def test_emitters_of_rounds():
    room = scene(rounds=3)
    assert room.last_emitters() == "results/room/round-3/emitters.npz"
    assert room.emitters_before("2") == "results/room/round-1/emitters.npz"
    assert room.emitters_of_fit("2") == ["results/room/round-2/emitters.npz"]
    assert room.emitters_before_fit("2") == ["results/room/round-1/emitters.npz"]
    assert room.emitters_before_fit("0") == []
    assert room.model_of_emitters("2") == []
    masked = scene(rounds=3, emitters={"decide": "mask"})
    assert masked.emitters_of_fit("2") == masked.emitters_before_fit("2") == []
    assert masked.model_of_emitters("2") == ["results/room/round-2/model.safetensors"]
    once = scene(rounds=3, emitters={"every_round": False})
    assert once.last_emitters() == once.emitters_before("2") == "results/room/round-0/emitters.npz"
    assert once.emitters_before_fit("2") == once.emitters_of_fit("2")


def test_an_export_is_checked_where_views_are_held_out(monkeypatch):
    assert "results/room/export/check.json" in scene().exported()
    assert scene().checked_export() == []
    assert scene({"settings": SIZE | {"export": {"enabled": True}}}).checked_export() == scene().exported()
    monkeypatch.setattr("fipt.config.views.SceneViews.of", lambda *_: [])
    assert scene().exported() == [scene().layout.export]


def test_one_light_at_a_time_is_of_held_out_views():
    assert scene().views.olat_shards() == {"val-000": ["val_000"]}
    assert scene().views.olat_listed("val-000") == "val_000"
    assert scene(olat={"views": 0}).olat() == []


def test_the_page_has_sections_on_what_a_run_makes():
    assert scene().sections() == []
    assert scene({"settings": SIZE | {"export": {"enabled": True}}}).sections() == ["export"]
    photographed = scene({"source": "procedural", "simulate_raw": True, "poses": "colmap", "mesh": "reconstruct"})
    assert photographed.sections() == ["capture", "poses", "geometry"]


def test_setups_are_seen_by_views_or_by_cameras_of_their_own():
    room = scene(setups={"night": {}, "walk": {"cameras": LOOK_AT}})
    assert (room.setups.of_views(), room.setups.with_cameras()) == (["night"], ["walk"])
    assert room.setups.relit() == ["results/room/relight/night.val-000.manifest.json"]
    assert room.setups.joined() == ["results/room/relight/walk.manifest.json"]
    assert room.setups.seen("walk") == ["results/room/relight/walk.camera-000.manifest.json"]
    assert room.setups.truth() == ["results/room/dataset/relight_truth.night.val-000.manifest.json"]
    assert room.setups.views() == ["val_000"]
    every = scene(setups={"night": {}}, relight={"split": "all"}).setups.views()
    assert every == scene().views.of("train", "val")


def test_setups_that_no_view_sees_have_no_truth(monkeypatch):
    """As in a room without held-out views: there is nothing to compare."""
    room = scene(setups={"night": {}})
    monkeypatch.setattr("fipt.config.views.SceneViews.of", lambda *_: [])
    assert room.setups.with_truth() == []


def test_what_is_read_late_is_looked_for_early(tmp_path):
    given = {"mode": "given", "file": str(tmp_path / "sky.exr")}
    with pytest.raises(FiptError, match=r"environment\.file is missing"):
        scene(environment=given).check()
    (tmp_path / "sky.exr").touch()
    scene(environment=given).check()


def test_a_layer_may_tune_a_mode_that_another_does_not_choose():
    tuned = {"segment": {"exposure": 2.0, "batch": 4}, "environment": {"resolution": 64}}
    assert scene(**tuned).settings["segment"].mode == "auto"
    network = scene({"settings": SIZE | {"segment": {"mode": "mask2former"}}}, **tuned).settings["segment"]
    assert (network.exposure, network.batch) == (2.0, 4)
    paper = scene({"preset": "paper"}, **tuned)
    assert paper.settings["environment"].mode == "none"
    with pytest.raises(
        FiptError, match=r"scene room: segment\.path is only for mode given; mode is auto; remove it, or"
    ):
        scene(segment={"path": "ids"})
