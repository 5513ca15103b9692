"""Outputs for one view, and the protocol with photographs under another light as input."""

import json

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.config import load
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.scene.dataset import Dataset
from fipt.scene.samples import write_samples
from tests.scenes import samples_of
from tests.unit.stages.import_results.test_stage import KD, call, metrics, room, size  # noqa: F401 - room: a fixture

THEIRS = "brdf/theirs/kitchen"
SCENE = {"source": "procedural", "settings": {"synthesize": {"train_views": 3, "val_views": 2}}}


def write(room, name, values):  # noqa: F811
    write_exr(room / name, {"": np.asarray(values, np.float32)})


def test_one_view_is_judged_alone(room, capsys):  # noqa: F811
    write(room, f"{THEIRS}/001_kd.exr", np.full((*size(room, 1), 3), KD + 0.1))
    call(room, {"method": "theirs"}, code=2)
    assert "import_results.only names" not in (line := capsys.readouterr().err)
    assert ("000_kd.exr missing" in line, "import_results.only" in line) == (True, True)
    call(room, {"method": "theirs", "only": ["z"]}, code=2)
    assert "import_results.only names z, no view of train and none held out" in capsys.readouterr().err
    call(room, {"method": "theirs", "only": ["b"]})
    assert [path.name for path in (room / "run" / "materials").iterdir()] == ["b.exr"]
    found = metrics(room)["train"]
    assert found["kd_psnr"] == pytest.approx(20.0, abs=1e-3)
    height, width = size(room, 1)
    assert found["pixels"]["materials"] == height * width


def test_depth_of_another_view_is_named(room, caplog):  # noqa: F811
    data = Dataset(room / "room")
    cameras = [data.camera(view) for view in ("a", "b")]
    depth, places = [], []
    for camera in cameras:
        row, column = np.mgrid[: camera.height, : camera.width]
        directions = camera.directions(column.ravel() + 0.5, row.ravel() + 0.5)
        far = 1 + 2 * np.random.default_rng(len(places)).random(len(directions))
        places.append(camera.center + far[:, None] * directions)
        depth.append(camera.project(places[-1])[1].reshape(camera.height, camera.width))
    shapes = tuple((camera.height, camera.width) for camera in cameras)
    write_samples(room / "samples", samples_of(np.concatenate(places), views=("a", "b"), shapes=shapes))
    for number in range(2):
        write(room, f"{THEIRS}/{number:03d}_kd.exr", np.full((*shapes[number], 3), KD))
    for order, said in (((0, 1), 0), ((1, 0), 2)):
        for number, own in enumerate(order):
            write(room, f"{THEIRS}/{number:03d}_depth.exr", 1000 * np.repeat(depth[own][..., None], 3, 2))  # mm
        caplog.clear()
        call(room, {"method": "theirs"})
        assert sum("depth is not that of the mesh" in record.message for record in caplog.records) == said


def test_pictures_relit_are_compared_with_photographs(room, capsys):  # noqa: F811
    """The setup has no truth, only photographs, of another exposure."""
    picture = np.random.default_rng(0).uniform(0.1, 0.6, (*size(room), 3))
    settings = {"method": "theirs", "setup": "evening", "input": "reference"}
    write(room, "relight/theirs/kitchen/000.exr", picture)
    write(room, "photos/c.exr", 3 * picture)
    call(room, settings, code=2)
    assert "of which" in (line := capsys.readouterr().err)
    assert "--reference no photographs" in line
    options = ["--dataset", room / "room", "--samples", room / "samples", "--scene", "kitchen", "--out", room / "run"]
    options += ["--manifest", room / "run/others.manifest.json", "--reference", f"evening={room / 'photos'}"]
    given = json.dumps(settings | {"path": str(room)})
    assert main(["import-results", *map(str, options), "--settings", given]) == 0
    folders = [text for name in ("materials", "render", "relight") for text in (f"--{name}", str(room / "run" / name))]
    out = room / "run" / "metrics.json"
    more = ["--partial", "--reference", f"evening={room / 'photos'}", "--out", str(out)]
    assert main(["metrics", "--dataset", str(room / "room"), *folders, *more]) == 0
    found = json.loads(out.read_text())["relight"]["evening"]
    assert (found["relight_psnr_views"], found["of"]) == ({"c": 100.0}, "reference")


def methods(setups=None, **settings):
    scene = SCENE | {"setups": setups or {}}
    return load({"scenes": {"room": scene}, "import_results": settings}).scenes["room"].methods


def test_the_card_says_what_a_room_lacks(room):  # noqa: F811
    assert "needs outputs of the program itself" in methods().reasons()["single-view"]
    assert "no outputs of this scene" in methods(path=str(room)).reasons()["single-view"]
    photographs = {"evening": {"reference": str(room / "photos")}}
    asked = {"path": str(room), "input": "reference", "only": ["val_001"]}
    assert "no setup names any" in methods(**asked).reasons()["single-view"]
    with pytest.raises(FiptError, match="must name a setup with photographs; found ''"):
        methods(photographs, **asked).reasons()
    write(room, "relight/li22/room/001.exr", np.ones((4, 4, 3)))
    write(room, "photos/val_001.exr", np.ones((4, 4, 3)))
    found = methods(photographs, **asked, setup="evening")
    assert "single-view" not in found.reasons()
    card = json.loads(found.card_json("single-view"))
    assert card["oracle"] == ["scale of every picture", "photographs under the other light"]
    assert (card["label"], card["views"]) == ("Single view (Li et al. 2022), 1 view only", ["val_001"])
    own = found.run("single-view").others
    assert own.compared() == ["--reference", f"evening={room / 'photos'}"]
    assert own.photographs() == [str(room / "photos/val_001.exr")]
    assert own.files() == [str(room / "relight/li22/room/001.exr")]


def test_only_the_setup_that_was_relit_last_counts(room):  # noqa: F811
    """The setup of the card was corrected: what was relit under the other one stays in the run's folder."""
    setups = {"evening": {}, "blue": {}}
    write(room, "relight/li22/room/001.exr", np.ones((4, 4, 3)))
    given = {"path": str(room), "only": ["val_001"]}
    assert methods(setups, **given, setup="blue").run("single-view").others.setups() == ["blue"]
    assert methods(setups, **given).run("single-view").others.setups() == []
