"""Runs of methods: which files they take over, which methods a scene can have."""

import json
import shutil

import pytest

from fipt.config import load
from fipt.config.methods import _STAGES
from fipt.errors import FiptError
from fipt.registry import SECTIONS
from tests.layouts import WRITERS

SIZE = {"synthesize": {"train_views": 3, "val_views": 1}}
METHODS = {"slow": {"label": "Slow", "kind": "ablation", "source": "here", "settings": {"fit": {"steps": 9}}}}


def config(entry=None, **keys):
    room = {"source": "procedural", "settings": SIZE} | (entry or {})
    return load({"scenes": {"room": room}, "rounds": 2, "methods": METHODS, **keys})


def where(found, name):
    """Of some files of a run: the scene or run in whose folder they lie."""
    run = found.scene(f"room/methods/{name}")
    files = ("dataset/mesh.ply", "samples/a", "cache.npz", "round-0/shading/a", "round-0/emitters.npz", "round-1/model")
    roots = [run.where(f"{run.layout.root}/{file}").removesuffix(f"/{file}") for file in files]
    return [root.removeprefix("results/room").removeprefix("/methods/") or "room" for root in roots]


def test_a_run_takes_over_what_its_settings_do_not_change():
    found = config()
    assert where(found, "slow") == ["room"] * 4 + ["slow"] * 2
    assert where(found, "no-footprints") == ["room"] + ["no-footprints"] * 5
    assert where(found, "no-damping") == ["room"] * 5 + ["no-damping"]
    assert where(found, "rounds-1") == ["room"] * 6
    assert where(found, "irradiance") == ["room"] * 4 + ["irradiance"] * 2
    assert where(found, "fipt.seed-2") == ["room"] * 4 + ["fipt.seed-2"] * 2
    # a run with another seed differs from the own method's run with this seed by its method alone
    assert where(found, "rounds-1.seed-2") == ["room"] * 4 + ["fipt.seed-2"] * 2
    assert found.scene("room/methods/fipt") is found.scenes["room"]


def test_a_run_asks_for_the_files_that_it_takes_over():
    run = config().scene("room/methods/rounds-1")
    assert run.answer("last_model") == "results/room/round-1/model.safetensors"
    assert run.answer("last_emitters") == "results/room/round-1/emitters.npz"
    assert run.answer("images", splits=["val"]) == ["results/room/dataset/images.val-000.manifest.json"]
    assert config().scene("room/methods/irradiance").answer("last_confidence") == []


def test_another_cache_gives_another_environment_and_no_environment_another_cache():
    cards = {
        "coarse": METHODS["slow"] | {"settings": {"cache": {"resolution": 64}}},
        "dark": METHODS["slow"] | {"settings": {"environment": {"mode": "none"}}},
    }
    found = config(methods=cards)
    for name, files in (("coarse", ["coarse/cache.npz", "coarse/environment.npz"]), ("dark", ["dark/environment.npz"])):
        run = found.scene(f"room/methods/{name}")
        own = [f"{run.layout.root}/{file}" for file in ("cache.npz", "environment.npz")]
        assert [path for path in own if run.where(path) == path] == [f"results/room/methods/{file}" for file in files]


def test_files_are_taken_over_in_the_order_of_the_pipeline():
    *before, (last, _) = _STAGES
    places = [min(list(SECTIONS).index(section) for section in sections) for sections, _ in before]
    assert places == sorted(places)
    assert last == ("refine",)  # of later rounds, after the fit of the first


def test_runs_in_rooms_of_which_the_same_is_said_share_their_settings():
    said = {"source": "procedural", "settings": SIZE}
    rooms = {"hall": said, "attic": said, "cellar": said | {"settings": SIZE | {"fit": {"batch": 64}}}}
    found = load({"scenes": rooms, "methods": METHODS})
    for run in ("slow", "slow.seed-1"):
        hall, attic, cellar = (found.scene(f"{room}/methods/{run}").settings for room in rooms)
        assert hall is attic
        assert cellar["fit"].batch == 64 != hall["fit"].batch
    assert hall["fit"].seed == found.scene("hall/methods/slow").settings["fit"].seed + 1


def test_methods_that_need_what_a_room_lacks_have_a_reason():
    methods = config(segment={"mode": "none"}, rounds=1, compare={"seeds": 2}).scenes["room"].methods
    reasons = methods.reasons()
    assert reasons["irradiance"] == "needs segment ids, and the scene has none"
    assert reasons["paper"] == "needs round 2, and the last of the scene is 1"
    assert reasons["rounds-1"] == "is the scene's own run: its settings are the same"
    names = [run.name for run in methods.runs()]
    assert names[:2] == ["fipt", "fipt.seed-1"]
    assert not reasons.keys() & set(names)
    assert "--not-applicable" in methods.options()
    photographs = load({"scenes": {"room": {"source": "raw", "path": "p", "poses": "colmap", "mesh": "m"}}})
    assert "no" in photographs.scenes["room"].methods.reasons()["bound-constants"]


def test_quick_comparisons_have_one_seed_and_quick_methods():
    methods = config(compare={"quick": True}).scenes["room"].methods
    assert {run.name for run in methods.runs()} == {
        "fipt",
        "bound-constants",
        "ipt-reimpl",
        "irradiance",
        "rounds-0",
        "rounds-1",
    }
    named = config(compare={"quick": True, "methods": ["slow"]}).scenes["room"].methods
    assert [run.name for run in named.runs()] == ["fipt", "slow"]


def test_every_method_with_random_numbers_has_seeds():
    methods = config(compare={"seeds": 2}).scenes["room"].methods
    names = {run.name for run in methods.runs()}
    assert {"ipt-reimpl.seed-1", "texture-prb.seed-1", "field-prb.seed-1", "no-segments.seed-1"} <= names
    assert not {"irradiance.seed-1", "bound-constants.seed-1"} & names
    card = json.loads(methods.card_json("ipt-reimpl.seed-1"))
    assert (card["random"], card["settings"]) == (True, {"inverse_trace": {"seed": 1}})
    assert not json.loads(methods.card_json("irradiance"))["random"]


def test_a_card_says_what_a_run_changes():
    methods = config().scenes["room"].methods
    card = json.loads(methods.card_json("slow.seed-1"))
    assert (card["id"], card["seed"], card["rounds"]) == ("slow", 1, 2)
    assert card["settings"] == {"fit": {"seed": 1, "steps": 9}, "refine": {"seed": 1}}
    assert "results/room/stats/samples.train-000.json" in methods.stats("slow")
    assert "results/room/methods/slow/stats/fit.round-2.json" in methods.stats("slow")
    assert "results/room/stats/fit.round-1.json" in methods.stats("rounds-1")


def test_a_card_says_what_only_plans_read():
    once = METHODS["slow"] | {"settings": {"emitters": {"every_round": False}}}
    card = json.loads(config(methods={"once": once}).scenes["room"].methods.card_json("once"))
    assert card["settings"] == {"emitters": {"every_round": False}}


def test_a_method_with_planted_errors_may_check_cameras_in_its_own_way():
    settings = {"plant_errors": {"mesh_noise": 0.01}, "check_poses": {"enabled": False}}
    run = config(methods={"a": METHODS["slow"] | {"settings": settings}}).scene("room/methods/a")
    assert run.where(run.layout.checked_poses) == run.layout.checked_poses
    assert run.checks_poses is False


def jobs(name, **keys):
    """Jobs whose time a method bears."""
    files = config(**keys).scenes["room"].methods.stats(name)
    return [file.rpartition("/stats/")[2].removesuffix(".json") for file in files]


def test_every_method_bears_the_time_of_the_segments_that_it_takes():
    for name in ("fipt", "irradiance", "ipt-reimpl"):
        seen = jobs(name, segment={"mode": "degraded"})
        assert {"segment.train-000", "fuse"} <= set(seen)
        assert "segment.val-000" not in seen
        grown = jobs(name, segment={"mode": "geometry"})
        assert "fuse" in grown
        assert "segment.train-000" not in grown
    given = {*jobs("fipt"), *jobs("no-segments", segment={"mode": "degraded"})}
    assert not {"segment.train-000", "fuse"} & given


def test_no_method_bears_the_time_of_emitters_that_it_does_not_take():
    assert [job for job in jobs("paper") if job.startswith("emitters")] == ["emitters.round-0"]
    assert [job for job in jobs("fipt") if job.startswith("emitters")] == [f"emitters.round-{k}" for k in range(3)]


def test_an_imported_room_has_true_materials_where_its_layout_brings_them(tmp_path):
    for name in ("fipt-synthetic", "fipt-real", "nerfstudio"):
        WRITERS[name](tmp_path / name)
        room = {"source": "dataset", "path": str(tmp_path / name), "format": name}
        source = load({"scenes": {"room": room}}).scenes["room"].source
        assert source.has_truth == (name == "fipt-synthetic")
    shutil.rmtree(next((tmp_path / "fipt-synthetic").rglob("BaseColor")))
    room = {"source": "dataset", "path": str(tmp_path / "fipt-synthetic"), "format": "fipt-synthetic"}
    assert not load({"scenes": {"room": room}}).scenes["room"].source.has_truth


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"compare": {"methods": ["ours"]}}, "there is no method 'ours'"),
        ({"methods": {"a.seed-1": METHODS["slow"]}}, "must not be called 'a.seed-1'"),
        ({"methods": {"../a": METHODS["slow"]}}, "method"),
        ({"methods": {"fipt": METHODS["slow"]}}, "methods.fipt is the scene's own run"),
        ({"methods": {"a": METHODS["slow"] | {"settings": {"fit": {"stepz": 1}}}}}, "unknown key methods.a.settings"),
        *(
            ({"methods": {"a": METHODS["slow"] | {"settings": settings}}}, f"methods.a.settings.{section} would change")
            for section, settings in {
                "synthesize": {"synthesize": {"spp": 4}},
                "capture": {"capture": {"downscale": 2}},
                "poses": {"poses": {"align": {"reference": "p.json"}}},
                "import": {"plant_errors": {"mesh_noise": 0.01}, "import": {"downscale": 2}},
                "depth": {"depth": {"given": "d"}},
                "geometry": {"geometry": {"method": "mvs"}},
                "check_poses": {"check_poses": {"enabled": False}},
            }.items()
        ),
    ],
)
def test_wrong_methods_are_refused_in_a_line(keys, said):
    with pytest.raises(FiptError) as caught:
        config(**keys).scenes["room"].methods.runs()
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
