"""The verbs of known rooms with --scene: a scene file becomes a dataset, its relit truth and a RAW capture."""

import json
import shutil

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.conventions import LUMINANCE
from fipt.formats.exr import read_rgb
from fipt.formats.manifests import read_manifest
from fipt.scene.dataset import Dataset
from tests import captures, modelled

SETTINGS = {"train_views": 3, "val_views": 1, "width": 32, "height": 24, "spp": 8, "max_depth": 3, "denoise": False}
SHARDS = {"train-000": "train_000,train_001", "train-001": "train_002", "val-000": "val_000"}


def call(verb, *options, settings=SETTINGS) -> int:
    return main([verb, *map(str, options), "--settings", json.dumps(settings)])


@pytest.fixture(scope="module")
def scene(backend, tmp_path_factory):
    """A scene file in scene/, made into dataset/ in three shards."""
    root = tmp_path_factory.mktemp("modelled")
    file, data = modelled.write_scene(root / "scene"), root / "dataset"
    assert call("synthesize-room", "--dataset", data, "--scene", file, "--stats", root / "room.json") == 0
    for shard, views in SHARDS.items():
        options = ("--views", views, "--manifest", data / f"images.{shard}.manifest.json")
        assert call("synthesize-views", "--dataset", data, "--scene", file, *options) == 0
    return root


def test_the_dataset_has_pictures_ids_and_truth(scene):
    data = Dataset(scene / "dataset")
    names = {kind: json.loads((data.root / "segments" / f"{kind}.json").read_text()) for kind in ("part", "semantic")}
    assert list(names["part"].values()) == ["walls", "floor", "cupboard", "lamp"]
    assert list(names["semantic"].values())[:2] == ["paint", "tiles"]
    floor = next(key for key, name in names["part"].items() if name == "floor")
    colors = []
    for camera in data.cameras:
        truth, part, semantic = data.truth(camera.name), *(data.segments(camera.name, kind) for kind in names)
        assert part.min() > 0
        here = part == int(floor)
        assert {names["semantic"][str(k)] for k in np.unique(semantic[here])} <= {"tiles"}
        np.testing.assert_allclose(truth["roughness"][here], np.sqrt(0.2), rtol=1e-3)
        colors.append(truth["base_color"][here])
        assert data.image(camera.name)[0].min() >= 0
    colors = np.concatenate(colors)
    assert np.ptp(colors, axis=0).min() > 0.3, "a texture"
    made = read_manifest(scene / "dataset" / "images.train-000.manifest.json", "synthesize")
    assert made["settings"]["scene_file"].endswith("room.xml")
    assert len(made["files"]) == 8


def test_exposure_is_measured_once_and_recorded(scene):
    data = Dataset(scene / "dataset")
    room = json.loads((data.root / "room.json").read_text())
    medians = [np.median(data.image(view)[0] @ np.float32(LUMINANCE)) for view in data.views("train")]
    assert np.median(medians) == pytest.approx(0.25, rel=0.15)
    (lamp,) = room["emitters"]
    np.testing.assert_allclose(lamp["radiance"], np.multiply((6, 5, 4), room["exposure"]), rtol=1e-4)
    assert room["coverage"] == json.loads((scene / "room.json").read_text())["coverage"]
    assert any(note.startswith("material tiles: ") for note in room["notes"])


def test_pictures_do_not_depend_on_the_shard(scene, tmp_path):
    data = tmp_path / "dataset"
    shutil.copytree(scene / "dataset", data, ignore=shutil.ignore_patterns("images"))
    file = scene / "scene" / "room.xml"
    assert call("synthesize-views", "--dataset", data, "--scene", file, "--views", "train_002,train_001") == 0
    for view in ("train_001", "train_002"):
        name = f"images/{view}.exr"
        np.testing.assert_array_equal(read_rgb(data / name), read_rgb(scene / "dataset" / name))


def test_relit_truth_counts_lamps_as_room_json_lists_them(scene):
    setup = json.dumps({"emitters": [{"index": 0, "scale": 0.5}]})
    options = ("--views", "val_000", "--setup", setup, "--setup-name", "dim")
    assert (
        call("synthesize-relit", "--dataset", scene / "dataset", "--scene", scene / "scene" / "room.xml", *options) == 0
    )
    relit = read_rgb(scene / "dataset" / "relight_truth" / "dim" / "val_000.exr")
    np.testing.assert_allclose(relit, 0.5 * read_rgb(scene / "dataset" / "images" / "val_000.exr"), rtol=1e-4)


def test_a_simulated_camera_photographs_it(scene, tmp_path):
    settings = SETTINGS | {"raw": {**captures.SMALL, "exposures": 3, "calibration_frames": 2}}
    file, room, raw = scene / "scene" / "room.xml", tmp_path / "room", tmp_path / "raw"
    assert call("synthesize-room", "--dataset", room, "--scene", file, settings=settings) == 0
    assert call("photograph-calibration", "--dataset", room, "--raw", raw, settings=settings) == 0
    options = ("--dataset", room, "--scene", file, "--views", "val_000", "--raw", raw)
    assert call("photograph", *options, settings=settings) == 0
    assert len(list(raw.glob("*.dng"))) == 3
    truth = read_rgb(raw / "truth" / "val_000.exr")
    assert np.median(truth) == pytest.approx(np.median(read_rgb(scene / "dataset/images/val_000.exr")), rel=0.2)


@pytest.mark.parametrize(
    ("verb", "options", "message"),
    [
        ("views", ["--views", "train_000", "--scene", "{scene}", "--settings", '{"width": 64}'], "other settings"),
        ("views", ["--views", "train_000"], "other settings"),
        ("room", ["--scene", "nowhere.xml"], "nowhere.xml"),
    ],
)
def test_bad_input_gets_one_line_and_code_2(scene, capsys, verb, options, message):
    options = [text.format(scene=scene / "scene" / "room.xml") if "{scene}" in text else text for text in options]
    if "--settings" not in options:
        options += ["--settings", json.dumps(SETTINGS)]
    before = sorted(scene.rglob("*"))
    assert main([f"synthesize-{verb}", "--dataset", str(scene / "dataset"), *options]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("fipt: error")]
    assert len(error) == 1
    assert message in error[0]
    assert sorted(scene.rglob("*")) == before
