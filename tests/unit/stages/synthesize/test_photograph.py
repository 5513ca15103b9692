"""The simulated camera: a known room, or any dataset, through RAW."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import rawpy

from fipt.cli.main import main
from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.manifests import read_manifest
from fipt.scene.cameras import read_transforms, write_transforms
from fipt.scene.dataset import read_layers
from fipt.scene.mesh import read_mesh, write_ply
from tests import captures, scenes

CAMERA = {**captures.SMALL, "exposures": 3, "calibration_frames": 2, "read_noise": 0.5}
SETTINGS = {
    "train_views": 1,
    "val_views": 1,
    "width": 32,
    "height": 24,
    "spp": 32,
    "max_depth": 3,
    "denoise": False,
    "raw": CAMERA,
}


def call(verb, *options, settings=SETTINGS) -> int:
    return main([verb, *map(str, options), "--settings", json.dumps(settings)])


@pytest.fixture(scope="module")
def scene(backend, tmp_path_factory):
    """The room as dataset/, photographed into raw/."""
    root = tmp_path_factory.mktemp("scene")
    data, raw = root / "dataset", root / "raw"
    assert call("synthesize-room", "--dataset", data) == 0
    assert (
        call("photograph-calibration", "--dataset", data, "--raw", raw, "--manifest", root / "raw.manifest.json") == 0
    )
    for split in ("train", "val"):
        made = root / f"raw.{split}-000.manifest.json"
        options = ("--views", f"{split}_000", "--raw", raw, "--manifest", made)
        assert call("photograph", "--dataset", data, *options, "--stats", root / f"{split}.json") == 0
    return root


def test_brackets_come_instead_of_pictures(scene):
    assert sorted(p.name for p in (scene / "raw").glob("*.dng")) == [f"DSC{k:05d}.dng" for k in range(1, 7)]
    assert not (scene / "dataset" / "images").exists()
    for name in ("train_000", "val_000"):
        assert (scene / "dataset" / "truth" / f"{name}.exr").is_file()
        assert (scene / "dataset" / "segments" / "part" / f"{name}.png").is_file()


def test_manifests_list_what_each_call_wrote(scene):
    def listed(name: str) -> list[str]:
        return sorted(read_manifest(scene / name, "synthesize")["files"])

    assert listed("raw.val-000.manifest.json") == [
        "dataset/segments/part/val_000.png",
        "dataset/segments/semantic/val_000.png",
        "dataset/truth/val_000.exr",
        *(f"raw/DSC{k:05d}.dng" for k in (4, 5, 6)),
        "raw/truth/val_000.exr",
    ]
    rest = listed("raw.manifest.json")
    assert {"raw/captures.tsv", "raw/mesh.ply", "raw/transforms.json", "raw/truth/camera.json"} <= set(rest)
    assert sum("checkerboard" in name for name in rest) == 2
    assert json.loads((scene / "val.json").read_text())["views"] == 1


def test_the_capture_has_the_rooms_cameras_and_mesh(scene):
    ours, rooms = (read_transforms(scene / folder / "transforms.json") for folder in ("raw", "dataset"))
    for camera, other in zip(ours, rooms, strict=True):
        assert (camera.name, camera.split, camera.fx, camera.cx) == (other.name, other.split, other.fx, other.cx)
        np.testing.assert_array_equal(camera.world_from_camera, other.world_from_camera)
    mesh, truth = (read_mesh(scene / folder / "mesh.ply") for folder in ("raw", "dataset"))
    np.testing.assert_array_equal(mesh.triangles, truth.triangles)


def test_the_true_view_is_the_picture_that_would_have_been_written(scene, tmp_path):
    data = tmp_path / "dataset"
    assert call("synthesize-room", "--dataset", data) == 0
    assert call("synthesize-views", "--dataset", data, "--views", "val_000") == 0
    picture = read_rgb(data / "images" / "val_000.exr")
    truth = read_layers(scene / "raw" / "truth" / "val_000.exr")[""]
    # Both are noisy renderings of the same view, with different paths.
    assert np.median(truth / picture) == pytest.approx(1, abs=0.05)
    likeness = [
        np.corrcoef(np.log(truth[2:-2, 2:-2]).ravel(), np.log(picture[2 + y : 22 + y, 2 + x : 30 + x]).ravel())[0, 1]
        for y in (0, -1, 1)
        for x in (0, -1, 1)
    ]
    assert likeness[0] == max(likeness) > 0.85
    layers = (read_layers(root / "truth" / "val_000.exr") for root in (data, scene / "dataset"))
    for name, values in next(layers).items():
        np.testing.assert_array_equal(values, read_layers(scene / "dataset" / "truth" / "val_000.exr")[name])


def test_the_room_with_an_open_window(backend, tmp_path, capsys):
    """Every step must build the room that synthesize-room made."""
    settings = SETTINGS | {"opening": True, "spp": 4, "max_depth": 2, "raw": CAMERA}
    room, data, raw = (tmp_path / name for name in ("room", "dataset", "raw"))
    room_cameras = room / "transforms.json"
    assert call("synthesize-room", "--dataset", room, settings=settings) == 0
    assert call("photograph-calibration", "--dataset", room, "--raw", raw, settings=settings) == 0
    assert call("photograph", "--dataset", room, "--views", "val_000", "--raw", raw, settings=settings) == 0
    shutil.copytree(room, data, ignore=shutil.ignore_patterns("truth"))
    assert call("synthesize-truth", "--dataset", data, "--views", "val_000", settings=settings) == 0
    layers, again = (read_layers(folder / "truth" / "val_000.exr") for folder in (room, data))
    for name, values in layers.items():
        np.testing.assert_array_equal(again[name], values)
    # estimated cameras stand in coordinates of their own, and the truth is that of where the photograph was taken
    turn = np.array([[0.0, 0, 1, 2], [0, 1, 0, 0], [-1, 0, 0, 1], [0, 0, 0, 1]])
    views = [replace(view, world_from_camera=turn @ view.world_from_camera) for view in read_transforms(room_cameras)]
    write_transforms(data / "transforms.json", views)
    options = ("--dataset", data, "--views", "val_000", "--cameras", room_cameras)
    assert call("synthesize-truth", *options, settings=settings) == 0
    assert "of another room" not in capsys.readouterr().err
    for name, values in read_layers(data / "truth" / "val_000.exr").items():
        np.testing.assert_array_equal(values, layers[name])
    given = options[:-1]
    capsys.readouterr()
    far = [replace(view, world_from_camera=view.world_from_camera + 500 * np.eye(4, 4, 3)) for view in views]
    write_transforms(tmp_path / "far.json", far)
    assert call("synthesize-truth", *given, tmp_path / "far.json", settings=settings) == 2
    assert "view val_000 must see the room; its camera in" in capsys.readouterr().err
    true = read_transforms(room_cameras)
    shifted = [replace(view, name=other.name) for view, other in zip(true, true[1:] + true[:1], strict=True)]
    write_transforms(tmp_path / "shifted.json", shifted)
    assert call("synthesize-truth", *given, tmp_path / "shifted.json", settings=settings) == 0
    assert "are not turned to each other as those of" in capsys.readouterr().err
    write_transforms(tmp_path / "others.json", views[:1])
    assert views[0].name != "val_000"
    options = (*options[:-1], tmp_path / "others.json")
    assert call("synthesize-truth", *options, settings=settings) == 2


def test_any_dataset_can_be_photographed(scene, tmp_path):
    given = captures.cameras(2)
    write_transforms(tmp_path / "dataset" / "transforms.json", given)
    write_ply(tmp_path / "dataset" / "mesh.ply", scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    for camera in given:
        write_exr(tmp_path / "dataset" / "images" / f"{camera.name}.exr", {"": captures.scene_image(camera)})
    settings = {"raw": CAMERA | {"scale": 1}}
    stats = tmp_path / "stats.json"
    options = ("--dataset", tmp_path / "dataset", "--raw", tmp_path / "raw", "--stats", stats)
    assert call("photograph-images", *options, settings=settings) == 0
    views = read_transforms(tmp_path / "raw" / "transforms.json")
    assert [view.name for view in views] == [c.name for c in given]
    assert json.loads(stats.read_text())["views"] == len(views)
    assert len(list((tmp_path / "raw").glob("*.dng"))) == 3 * len(views)
    whole, view = read_rgb(tmp_path / "dataset" / "images" / f"{views[0].name}.exr"), views[0]
    truth = read_layers(tmp_path / "raw" / "truth" / f"{view.name}.exr")[""]
    left, top = round(given[0].cx - view.cx), round(given[0].cy - view.cy)
    assert left > 0
    assert top > 0
    np.testing.assert_allclose(truth, whole[top : top + view.height, left : left + view.width], rtol=1e-6)
    with rawpy.imread(str(tmp_path / "raw" / "DSC00001.dng")) as raw:
        assert raw.raw_image_visible.shape == (view.height, view.width)


@pytest.mark.parametrize(
    ("verb", "options", "message"),
    [
        ("photograph", ["--views", "a", "--raw", "raw", "--manifest", "other/m.json"], "raw is not below other"),
        ("photograph", ["--views", "a", "--raw", "x/raw", "--manifest", "x/m.json"], "data is not below x"),
        ("photograph-calibration", ["--raw", "raw", "--manifest", "other/m.json"], "raw is not below other"),
        ("photograph-images", [], "--raw"),
    ],
)
def test_bad_options_get_code_2(capsys, verb, options, message):
    assert call(verb, "--dataset", "data", *options) == 2
    assert message in capsys.readouterr().err


def test_a_camera_that_cannot_be_is_one_line(scene, capsys):
    folded = SETTINGS | {"raw": CAMERA | {"distortion": [-0.9, 0, 0, 0, 0]}}
    before = sorted(scene.rglob("*"))
    options = ("--dataset", scene / "dataset", "--views", "val_000", "--raw", scene / "raw")
    assert call("photograph", *options, settings=folded) == 2
    assert "synthesize.raw.distortion" in capsys.readouterr().err
    assert sorted(scene.rglob("*")) == before
    wrong = SETTINGS | {"raw": {"lens": "RGGB"}}
    assert call("photograph", *options, settings=wrong) == 2
    assert "unknown key synthesize.raw.lens" in capsys.readouterr().err
