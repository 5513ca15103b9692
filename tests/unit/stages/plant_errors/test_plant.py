"""Planted errors: each changes what it says and nothing else, and the dataset that it is made of stays as it is."""

import json

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.config import load
from fipt.formats.manifests import file_hash
from fipt.scene.cameras import read_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import read_mesh
from fipt.stages.plant_errors.mesh import front_of, moved
from fipt.stages.plant_errors.views import exposures
from tests.scenes import VIEWS, box, turned, write_dataset


@pytest.fixture
def room(tmp_path):
    return write_dataset(tmp_path / "room")


def planted(room, code=0, **settings):
    out = room.parent / "out"
    options = ["--dataset", str(room), "--out", str(out), "--settings", json.dumps(settings)]
    assert main(["plant-errors", *options]) == code
    return out


def hashes(folder):
    return {path: file_hash(path) for path in sorted(folder.rglob("*")) if path.is_file()}


def test_noise_has_its_size_and_the_images_stay(room):
    before = hashes(room)
    out = planted(room, mesh_noise=0.01)
    change = read_mesh(out / "mesh.ply").vertices - read_mesh(room / "mesh.ply").vertices
    assert 0.003 < change.std() < 0.02
    assert hashes(room) == before
    view = Dataset(out).views("train")[0]
    assert np.array_equal(Dataset(out).image(view)[0], Dataset(room).image(view)[0])
    assert np.array_equal(Dataset(out).segments(view, "part"), Dataset(room).segments(view, "part"))


def test_training_cameras_are_turned_by_an_angle(room):
    out = planted(room, pose_angle=1.0)
    for true, off in zip(
        read_transforms(room / "transforms.json"), read_transforms(out / "transforms.json"), strict=True
    ):
        turn = true.world_from_camera[:3, :3].T @ off.world_from_camera[:3, :3]
        angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        assert angle == pytest.approx(1.0 if true.split == "train" else 0.0, abs=1e-3)
        assert np.allclose(true.center, off.center)


def test_a_small_share_of_few_views_is_one():
    rng = np.random.default_rng(0)
    assert list(exposures(["a", "b", "c"], 1.0, 0.1, rng).values()) == [2.0]
    assert exposures(["a", "b", "c"], 1.0, 0.0, rng) == {}


def test_some_exposures_are_off(room):
    before = hashes(room)
    out = planted(room, exposure_stops=1.0, exposure_share=0.5)
    ratios = [Dataset(out).image(v)[0].sum() / Dataset(room).image(v)[0].sum() for v in Dataset(room).views("train")]
    assert sorted({round(float(ratio), 3) for ratio in ratios} - {1.0}) in ([2.0], [0.5, 2.0])
    assert hashes(room) == before


def test_the_front_of_a_part_is_moved_and_its_sides_are_stretched():
    cupboard = turned(box((0, 0, 0), (1, 1, 0.4)))
    front, normal = front_of(cupboard, np.ones(12, bool), np.array([0.5, 0.5, 3.0]))
    assert front.sum() == 2
    assert normal == pytest.approx([0, 0, 1])
    found = moved(cupboard, front, 0.1 * normal)
    assert found.vertices[:, 2].max() == pytest.approx(0.5)
    assert sorted({round(float(z), 3) for z in found.vertices[:, 2]}) == [0.0, 0.5]


def test_parts_are_moved_or_missing_in_rooms_that_name_them(room, capsys):
    assert planted(room, code=2, moved_part="a")
    assert "no room.json, which tells parts" in capsys.readouterr().err
    count = len(read_mesh(room / "mesh.ply").triangles)
    (room / "room.json").write_text(
        json.dumps({"parts": [{"name": "walls", "triangles": count - 2}, {"name": "lamp", "triangles": 2}]})
    )
    planted(room, code=2, removed_parts=["lamps"])
    assert "there is no part 'lamps'; parts: walls, lamp" in capsys.readouterr().err
    assert not (room.parent / "out" / "mesh.ply").exists()
    (room / "prepare.json").write_text('{"prepared": true}\n')
    out = planted(room, removed_parts=["lamp"])
    assert (out / "prepare.json").read_text() == '{"prepared": true}\n'  # findings read it beside the images
    assert len(read_mesh(out / "mesh.ply").triangles) == count - 2
    assert not (out / "room.json").exists()  # its triangles are those of another mesh


def test_a_run_with_errors_has_a_dataset_of_its_own():
    scene = {"source": "procedural", "settings": {"synthesize": {"train_views": len(VIEWS), "val_views": 1}}}
    compare = {"methods": ["irradiance"], "sensitivity": ["mesh noise", "ids-grown"]}
    found = load({"scenes": {"room": scene}, "compare": compare, "rounds": 0})
    methods = found.scenes["room"].methods
    assert methods.chosen == ["fipt", "irradiance", "mesh-noise-2mm", "mesh-noise-5mm", "mesh-noise-10mm", "ids-grown"]
    assert methods.findings("mesh-noise-2mm") == ["results/room/methods/mesh-noise-2mm/findings.json"]
    run = found.scene("room/methods/mesh-noise-2mm")
    own = [run.where(f"{run.layout.root}/{name}") for name in ("dataset/mesh.ply", "cache.npz", "dataset")]
    assert all(path.startswith("results/room/methods/") for path in own)
    assert run.answer("images", splits=["val"]) == ["results/room/methods/mesh-noise-2mm/dataset/images.manifest.json"]
    seeded = found.scene("room/methods/mesh-noise-2mm.seed-1")
    for other in (run, seeded):  # a run with another seed has its parent's dataset, too
        before = other.answer("before_errors")
        assert all(path.startswith("results/room/dataset/") for path in before)
        assert "results/room/dataset/images.train-000.manifest.json" in before
        assert other.answer("dataset_before_errors") == "results/room/dataset"
    assert run.where(f"{run.layout.root}/dataset/room.json") == "results/room/dataset/room.json"
    assert not [name for name in load({"scenes": {"room": scene}}).scenes["room"].methods.chosen if "mm" in name]


@pytest.mark.parametrize("raw", [False, True])
def test_what_an_import_said_is_read_where_there_was_one(raw):
    scene = {"source": "procedural", "simulate_raw": raw}
    found = load({"scenes": {"room": scene}, "compare": {"methods": [], "sensitivity": ["mesh noise"]}})
    run = found.scene("room/methods/mesh-noise-2mm")
    assert ("results/room/dataset/prepare.json" in run.answer("before_errors")) == raw
