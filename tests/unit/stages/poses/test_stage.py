"""``fipt pose`` on images of a painted room: poses found, and every input that cannot give them refused."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.conventions import FLAG_MOVED, FLAG_SATURATED
from fipt.formats.exr import write_exr
from fipt.scene.cameras import read_transforms, write_transforms
from fipt.scene.dataset import read_rejected
from fipt.stages.poses import estimate, matching
from fipt.stages.poses.settings import PosesSettings
from fipt.stages.poses.similarity import rotation_angles
from fipt.stages.poses.views import read_capture, read_folder
from tests import painted_room

PLACE = painted_room.SIZE * (0.5, 0.55, 0.5)
FEW = {"max_features": 800, "peak": 0.01, "threads": 2}
"""Enough for walls that are painted all over."""


def pose(folder, **settings):
    """Exit code of the verb on a folder of views whose true poses are known."""
    options = ["--source", folder, "--intrinsics", folder / "intrinsics.json", "--out", folder / "poses"]
    values = {**FEW, "align": {"reference": str(folder / "truth.json")}, **settings}
    return main(["pose", *map(str, options), "--held-out", "view_00", "--settings", json.dumps(values)])


def made(folder, cameras, **options):
    """Write images of the cameras, and what is true of them."""
    painted_room.write_views(folder, cameras, **options)
    write_transforms(folder / "truth.json", cameras)
    return folder


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """Six views of one wall of the room and its neighbours, and one that shows nothing."""
    cameras = [*painted_room.ring(6, width=320), painted_room.camera("wall", PLACE, 200, width=320)]
    folder = made(tmp_path_factory.mktemp("ring"), cameras)
    write_exr(folder / "wall.exr", {"": painted_room.image(cameras[-1], blank=True)})
    return folder


def test_cameras_are_found_and_a_bare_wall_is_rejected(ring, capsys):
    assert pose(ring) == 0
    truth = {camera.name: camera for camera in read_transforms(ring / "truth.json")}
    found = read_transforms(ring / "poses" / "transforms.json")
    assert [camera.name for camera in found] == [name for name in truth if name != "wall"]
    assert [camera.split for camera in found] == ["val"] + ["train"] * 5
    for camera in found:
        true = truth[camera.name]
        # of a room of 5 m: measured 3 mm and 0.1 degrees when this was written
        assert np.linalg.norm(camera.center - true.center) < 0.01
        assert rotation_angles(camera.world_from_camera[:3, :3], true.world_from_camera[:3, :3]) < 0.3
    rejected = read_rejected(ring / "poses" / "views.json")
    assert list(rejected) == ["wall"]
    assert "too little texture" in rejected["wall"]
    assert "warning: view wall is rejected" in capsys.readouterr().err

    content = json.loads((ring / "poses" / "poses.json").read_text())
    assert content["views"]["view_04"]["agreement"]["shift"] < 0.01
    assert content["views"]["view_04"]["points"] > 30
    assert content["views"]["wall"]["accepted"] is False
    assert content["align"]["from"] == "reference"
    assert content["align"]["rms"] < 0.01
    assert [sorted(group) for group in content["groups"]] == [[camera.name for camera in found]]
    best = max(content["graph"], key=lambda pair: pair["shared_points"])
    assert abs(int(best["views"][0][-2:]) - int(best["views"][1][-2:])) == 1
    with Image.open(ring / "poses" / "poses.png") as image:
        assert len(np.unique(np.array(image))) > 50
    head = (ring / "poses" / "points.ply").read_bytes()[:200].decode("ascii", "replace")
    assert f"element vertex {content['points']}" in head


def test_the_same_poses_again_from_what_is_kept_and_from_nothing(ring):
    before = (ring / "poses" / "transforms.json").read_bytes()
    # (COLMAP touches a database when it opens it)
    kept = {path: path.stat().st_mtime_ns for path in (ring / "poses" / "work").rglob("*.[bp][in][ng]")}
    assert len(kept) > 20
    assert pose(ring) == 0
    assert (ring / "poses" / "transforms.json").read_bytes() == before
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    (ring / "poses" / "work").rename(ring / "elsewhere")
    assert pose(ring) == 0
    assert (ring / "poses" / "transforms.json").read_bytes() == before


def test_images_from_which_no_poses_follow(tmp_path, capsys):
    def said(name, cameras, **options):
        assert pose(made(tmp_path / name, cameras, **options)) == 2
        assert not (tmp_path / name / "poses" / "transforms.json").exists()
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert error.startswith("fipt: error: ")
        return error

    turned = [painted_room.camera(f"view_{i}", PLACE, 20 * i, width=240) for i in range(4)]
    assert "all 4 images are of one place" in said("panorama", turned)
    two = painted_room.ring(3, step=15, prefix="a", width=320) + painted_room.ring(3, 180, 15, "b", width=320)
    error = said("two", two)
    assert "fall into 2 groups" in error
    assert "a_00, a_01, a_02" in error
    assert "b_00, b_01, b_02" in error
    assert "steps of 15 degrees" in said("steps", painted_room.ring(6, step=60, width=240))
    assert "too little texture" in said("bare", painted_room.ring(3, width=120), blank=True)
    assert "at least 3 views" in said("two_views", painted_room.ring(2, width=120))


def test_options_and_intrinsics(tmp_path, capsys):
    folder = made(tmp_path / "views", painted_room.ring(3, width=64))
    for keys, problem in (
        ({"w": 64, "h": 48}, "must hold w, h and fl_x"),
        ({"w": 64, "h": 48, "fl_x": -1}, "must be positive"),
        ({"w": 60, "h": 48, "fl_x": 50}, "must be 60x48 like its intrinsics; it is 64x48"),
    ):
        (folder / "intrinsics.json").write_text(json.dumps(keys))
        assert pose(folder) == 2
        assert problem in capsys.readouterr().err
    (folder / "intrinsics.json").write_text("[")
    assert pose(folder) == 2
    assert main(["pose", "--out", str(folder / "poses"), "--source", str(folder)]) == 2
    assert "--source with --intrinsics" in capsys.readouterr().err


def test_a_capture_without_intrinsics(tmp_path, capsys):
    names = ("a", "b", "c")
    for name in names:
        (tmp_path / f"{name}.json").write_text(json.dumps({"camera": None}))
    (tmp_path / "qa.json").write_text(json.dumps({"views": {name: {"accepted": True} for name in names}}))
    assert main(["pose", "--capture", str(tmp_path), "--out", str(tmp_path / "poses")]) == 2
    assert "the intrinsics of every view must be known; those of a, b, c are not" in capsys.readouterr().err


def test_the_orientation_of_photographs_reaches_the_search_for_up(tmp_path, monkeypatch):
    lens = {"w": 8, "h": 6, "fl_x": 8.0, "fl_y": 8.0, "cx": 4.0, "cy": 3.0}
    orientation = {"a": 6, "b": 1, "c": 8}
    for name, value in orientation.items():
        (tmp_path / f"{name}.json").write_text(json.dumps({"camera": lens, "orientation": value}))
        write_exr(tmp_path / "hdr" / f"{name}.exr", {"": np.ones((6, 8, 3), np.float32)})
    (tmp_path / "qa.json").write_text(json.dumps({"views": {name: {"accepted": True} for name in orientation}}))
    views = read_capture(tmp_path, [])
    assert views.orientation == orientation
    asked: list[Any] = []
    report = SimpleNamespace(plain=dict)
    monkeypatch.setattr("fipt.stages.poses.estimate.align", lambda *given: (asked.append(given[3]), (None, report))[1])
    estimate._aligned(None, views, PosesSettings())
    assert asked == [orientation]


def test_pixels_without_weight_are_not_shown_but_clipped_ones_and_their_neighbours(tmp_path):
    valid, flags = np.ones((12, 16), np.float32), np.zeros((12, 16), np.uint32)
    valid[6:] = 0  # a tripod
    flags[2, 2], flags[2, 12] = FLAG_SATURATED, FLAG_MOVED
    valid[1:4, 1:4] = valid[2, 12] = 0
    for name in "abc":
        layers = {"": np.ones((12, 16, 3), np.float32), "valid.Y": valid, "flags.Y": flags}
        write_exr(tmp_path / f"{name}.exr", layers)
    (tmp_path / "intrinsics.json").write_text(json.dumps({"w": 16, "h": 12, "fl_x": 16}))
    _, shown = read_folder(tmp_path, tmp_path / "intrinsics.json", ()).image("a")
    expected = np.ones((12, 16), bool)
    expected[6:] = expected[2, 12] = False
    np.testing.assert_array_equal(shown, expected)


def test_images_that_another_version_wrote_are_made_anew(ring, tmp_path, monkeypatch):
    views = read_folder(ring, ring / "intrinsics.json", ())
    first = matching._images(views, tmp_path)
    assert matching._images(views, tmp_path) == first
    monkeypatch.setitem(matching.VERSIONS, "poses", matching.VERSIONS["poses"] + 1)
    assert matching._images(views, tmp_path) != first


def test_a_missing_reference_is_told_before_the_work(ring, tmp_path, capsys):
    options = ["--source", ring, "--intrinsics", ring / "intrinsics.json", "--out", tmp_path / "poses"]
    settings = json.dumps({"align": {"reference": str(tmp_path / "none.json")}})
    assert main(["pose", *map(str, options), "--settings", settings]) == 2
    assert f"{tmp_path}/none.json" in capsys.readouterr().err
    assert not (tmp_path / "poses").exists()
