import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fipt.config import load, read
from fipt.config.reading import DEMO_FILE
from fipt.config.sections import LAYERS, PRESETS, STAGES
from fipt.config.sources.known import pose_files
from fipt.errors import FiptError
from fipt.formats.yaml import read_yaml
from fipt.registry import validated

REPOSITORY = Path(__file__).resolve().parents[3]
ROOM = {"source": "procedural"}


def scene(room=ROOM, **keys):
    return load({"scenes": {"room": room}, **keys}).scenes["room"]


def test_later_layers_win():
    defaults, demo = scene(), scene({**ROOM, "preset": "demo"})
    assert defaults.settings == {stage: validated(stage, {}) for stage in STAGES}
    own = {"fit": {"seed": 5}}
    room = {**ROOM, "preset": "demo", "settings": own}
    both = scene(room, fit={"seed": 4, "batch": 77})
    assert both.settings["fit"].seed == 5
    assert both.settings["fit"].batch == 77
    assert both.settings["fit"].steps == demo.settings["fit"].steps
    assert both.settings["synthesize"] == demo.settings["synthesize"]


def test_a_section_in_a_stage_keeps_what_a_later_layer_leaves_out():
    room = {**ROOM, "settings": {"synthesize": {"raw": {"bits": 12}}}}
    raw = scene(room, synthesize={"raw": {"scale": 2, "bits": 16}}).settings["synthesize"].raw
    assert (raw.scale, raw.bits, raw.pattern) == (2, 12, "RGGB")


def test_a_modelled_room_has_views_of_its_own_size_below_every_preset():
    room = {"source": "mitsuba", "path": "{data_root}/scene.xml"}
    made = scene(room, data_root="/rooms")
    chosen = made.settings["synthesize"]
    assert (chosen.train_views, chosen.val_views, chosen.width, chosen.height) == (24, 8, 320, 240)
    assert made.source.scene_options() == ["--scene", "/rooms/scene.xml"]
    assert (
        scene({**room, "preset": "demo"}).settings["synthesize"]
        == scene({**ROOM, "preset": "demo"}).settings["synthesize"]
    )
    assert (made.source.known, made.source.simulated, made.source.photographed) == (True, False, False)
    raw = scene({**room, "simulate_raw": True})
    assert (raw.source.known, raw.source.simulated, raw.source.photographed) == (True, True, True)
    assert not scene({**ROOM, "simulate_raw": False}).source.simulated
    assert scene().source.scene_options() == scene().source.scene_files() == []


@pytest.mark.parametrize("preset", sorted(path.stem for path in PRESETS.glob("*.yaml")))
def test_every_preset_is_valid(preset):
    scene({**ROOM, "preset": preset})


def test_preset_default_says_nothing():
    assert read_yaml(PRESETS / "default.yaml") == {}


def test_preset_paper_is_the_paper():
    settings = scene({**ROOM, "preset": "paper"}).settings
    assert settings["bake"].sampling == settings["refine"].sampling == "separate"
    assert (settings["refine"].diffuse_spp, settings["refine"].specular_spp) == (128, 64)
    assert settings["refine"].damping == 0
    assert settings["fit"].batch == 8192
    assert not settings["fit"].confidence_weights
    assert settings["fit"].learning_rate == settings["fit"].final_learning_rate == 1e-3
    assert not settings["emitters"].every_round


def test_views_and_shards():
    room = scene(views_per_shard=2, synthesize={"train_views": 3, "val_views": 1})
    assert room.source.views == {"train": ["train_000", "train_001", "train_002"], "val": ["val_000"]}
    train = {"train-000": ["train_000", "train_001"], "train-001": ["train_002"]}
    assert room.views.shards("train") == train
    assert room.views.shards("all") == {**train, "val-000": ["val_000"]}


def test_setups_are_joined():
    warm, off = {"emitters": [{"color": [1, 0.5, 0.2]}]}, {"emitters": [{"scale": 0}]}
    room = scene({**ROOM, "setups": {"off": off}}, setups={"warm": warm, "off": warm})
    assert list(room.setups.given) == ["warm", "off"]
    assert json.loads(room.setups.json("off"))["emitters"][0]["scale"] == 0


def test_settings_are_sorted_json():
    text = scene(fit={"steps": 3}).settings_json("fit")
    values = json.loads(text)
    assert list(values) == sorted(LAYERS["fit"].model_fields)
    assert values["steps"] == 3


def test_files_of_setups_are_placed_and_listed(tmp_path):
    (tmp_path / "chair.obj").write_text("mtllib chair.mtl\n")
    (tmp_path / "chair.mtl").write_text("newmtl a\n")
    setup = {
        "lights": [{"shape": "mesh", "file": "{data_root}/lamp.ply", "radiance": [1, 1, 1]}],
        "objects": [{"file": "{data_root}/chair.obj", "position": [0, 0, 0]}, {"shape": "cube", "position": [0, 0, 0]}],
    }
    room = scene({**ROOM, "setups": {"full": setup}}, data_root=str(tmp_path))
    assert room.setups.files("full") == [str(tmp_path / name) for name in ("lamp.ply", "chair.obj", "chair.mtl")]
    values = json.loads(room.setups.json("full"))
    assert values["lights"][0]["file"] == str(tmp_path / "lamp.ply")
    assert [entry["file"] for entry in values["objects"]] == [str(tmp_path / "chair.obj"), None]
    with pytest.raises(FiptError, match=r"scenes\.room\.setups\.full is .*, but data_root is not set"):
        scene({**ROOM, "setups": {"full": setup}}).setups.files("full")


def test_setups_that_name_fused_segments():
    setups = {
        "cut": {"remove": [{"segment": 3}]},
        "painted": {"materials": [{"at": [0, 0, 0], "metallic": 1}]},
        "boxed": {"remove": [{"box": {"center": [0, 0, 0], "size": [1, 1, 1]}}]},
    }
    room = {"source": "procedural", "setups": setups}
    parts, fused = scene(room), scene(room, segment={"mode": "geometry"})
    assert parts.setups.with_truth() == list(setups)
    assert not any(map(parts.setups.fused, setups))
    assert [name for name in setups if fused.setups.fused(name)] == ["cut", "painted"]
    assert fused.setups.with_truth() == ["boxed"]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"scenes": {}}, "scenes: dictionary should have at least 1 item"),
        ({"scenes": {"../x": ROOM}}, "scene '../x' cannot be used as a file name"),
        ({"scenes": {"x": {"source": "movie"}}}, "scenes.x.source: input should be 'procedural'"),
        ({"scenes": {"x": {"source": "mitsuba"}}}, "source: mitsuba needs path: a scene file (XML)"),
        ({"scenes": {"x": {"path": "a"}}}, "scenes.x.source is missing"),
        ({"scenes": {"x": {"source": "raw", "path": "a"}}}, "source: raw needs poses: colmap estimates them"),
        ({"scenes": {"x": {**ROOM, "presset": "demo"}}}, "unknown key scenes.x.presset (did you mean preset?)"),
        (
            {"scenes": {"x": {"source": "dataset", "path": "a", "format": "nerfstudio", "simulate_raw": True}}},
            "scenes.x.simulate_raw is only for source procedural or mitsuba; source is dataset",
        ),
        (
            {"scenes": {"x": {**ROOM, "path": "a"}}},
            "scenes.x.path is only for source mitsuba or dataset or raw; source is procedural",
        ),
        (
            {"scenes": {"x": {"source": "dataset", "path": "a"}}},
            "one of nerfstudio, fipt-synthetic, fipt-real",
        ),
        ({"setups": {"a/b": {}}}, "relight setup 'a/b' cannot be used"),
        (
            {"setups": {"a": {"cameras": {"look_at": {"b/c": {"position": [0, 0, 0], "target": [1, 0, 0]}}}}}},
            "camera of setup a: 'b/c' cannot be used",
        ),
        (
            {"setups": {"a": {"cameras": {"path": {"keyframes": ["x", {"posit": [0, 0, 0]}], "frames": 2}}}}},
            "unknown key setups.a.cameras.path.keyframes.1.posit (did you mean position?)",
        ),
        (
            {"setups": {"a": {"cameras": {"path": {"keyframes": ["x"], "frames": 2}}}}},
            "setups.a.cameras.path.keyframes: tuple should have at least 2 items",
        ),
        (
            {"setups": {"a": {"lights": [{"shape": "quad", "radiace": 1}]}}},
            "unknown key setups.a.lights.0.radiace (did you mean radiance?)",
        ),
        ({"setups": {False: {}}}, "setups: names must be text; found False; put it in quotes"),
        ({"views_per_shard": 0}, "views_per_shard: input should be greater than or equal to 1"),
        ({"fit": {"steps": "many"}}, "fit.steps: input should be a valid integer"),
        ({"fit": {"growth": float("nan")}}, "fit.growth: input should be"),
        ({"only": "y"}, "only: there is no scene 'y'; scenes: room"),
    ],
)
def test_refuses(keys, message):
    with pytest.raises(FiptError, match=re.escape(message)) as caught:
        load({"scenes": {"room": ROOM}, **keys})
    assert "\n" not in str(caught.value)


def test_data_root():
    room = {"source": "dataset", "format": "fipt-real", "path": "{data_root}/dataset"}
    assert scene(room, data_root="/data").source.path == "/data/dataset"
    with pytest.raises(FiptError, match=r"data_root is not set; add --config data_root=FOLDER"):
        _ = scene(room).source.path


def test_environment_maps_are_placed():
    room = {
        "source": "procedural",
        "settings": {"environment": {"mode": "given", "file": "{data_root}/sky.hdr"}},
        "setups": {"night": {"environment": {"file": "{data_root}/night.exr"}}, "dim": {"environment": {"scale": 0.5}}},
    }
    placed = scene(room, data_root="/data")
    assert placed.environment_files() == ["/data/sky.hdr"]
    assert json.loads(placed.settings_json("environment"))["file"] == "/data/sky.hdr"
    assert placed.setups.files("night") == ["/data/night.exr"]
    assert json.loads(placed.setups.json("night"))["environment"]["file"] == "/data/night.exr"
    assert placed.setups.files("dim") == []
    with pytest.raises(FiptError, match=r"settings\.environment\.file is .*, but data_root is not set"):
        scene(room).settings_json("environment")
    with pytest.raises(FiptError, match=r"scene room: environment\.radiance is only for mode constant; mode is none"):
        scene({"source": "procedural"}, environment={"mode": "none", "radiance": [1, 1, 1]})


def test_reads_files_and_overrides(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert list(read().scenes) == ["demo"]  # what is shipped, where there is nothing
    extra = tmp_path / "extra.yaml"
    extra.write_text("scenes: {attic: {source: procedural}}\nfit: {learning_rate: 1e-4, seed: 1}\n")
    assert list(read([extra]).scenes) == ["attic"]
    (tmp_path / "config").mkdir()
    (tmp_path / "config/config.yaml").write_text("scenes: {room: {source: procedural}}\n")
    found = read([extra], ["rounds=0", "fit={seed: 2}"])
    assert list(found.scenes) == ["room", "attic"]
    fit = found.scenes["attic"].settings["fit"]
    assert (found.rounds, fit.learning_rate, fit.seed) == (0, 1e-4, 2)
    with pytest.raises(FiptError, match="must be KEY=VALUE"):
        read([extra], ["rounds"])
    extra.write_text("a: [")
    with pytest.raises(FiptError, match="is not YAML"):
        read([extra])


def test_config_of_the_repository(monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    assert list(read().scenes) == ["demo"]
    assert list(read(["config/examples/living_room.yaml"]).scenes) == ["demo", "living_room"]
    assert read_yaml("config/config.yaml") == read_yaml(DEMO_FILE)


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "config" / "examples").glob("*.yaml")), ids=lambda path: path.stem
)
def test_examples_are_valid(path, monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    read([path], ["data_root=/data"])


def test_the_workflow_loads_nothing_heavy():
    code = "import sys, fipt.config; print({'numpy', 'torch', 'mitsuba', 'drjit', 'PIL'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_poses_of_a_known_room_are_estimated_from_photographs_only():
    raw = {"poses": {"align": {"reference": "{data_root}/known.json"}}}
    room = scene({**ROOM, "simulate_raw": True, "poses": "colmap"}, **raw, data_root="/data")
    assert room.source.estimated
    assert "--poses=results/room/poses/transforms.json" in as_flags(room.source.import_options())
    assert set(pose_files(room.layout)) < set(room.source.imported_files())
    assert json.loads(room.settings_json("poses"))["align"]["reference"] == "/data/known.json"
    assert room.reference_files() == ["/data/known.json"]
    with pytest.raises(
        FiptError, match=r"scenes\.room: poses of a known room may be colmap, where simulate_raw is true"
    ):
        scene({**ROOM, "poses": "colmap"})
    with pytest.raises(FiptError, match=r"scenes\.room\.poses: input should be 'colmap'; found 'poses\.json'"):
        scene({**ROOM, "poses": "poses.json", "simulate_raw": True})


def as_flags(options):
    return [f"{flag}={value}" for flag, value in zip(options[::2], options[1::2], strict=True)]


def test_rules_make_nothing_of_scenes_that_were_not_asked_for():
    """What another scene has made is imported as it is."""
    found = load({"scenes": {"known": ROOM, "room": ROOM, "other": ROOM}, "only": ["room"]})
    pattern = found.where("source.has_truth")
    assert [re.fullmatch(pattern, name) is not None for name in ("room", "known", "other")] == [True, False, False]
    two = load({"scenes": {"known": ROOM, "room": ROOM, "other": ROOM}, "only": ["room", "other"]})
    assert re.match(two.where("source.has_truth"), "known/dataset") is None
    assert re.match(two.where("source.has_truth") + "/dataset", "other/dataset")
