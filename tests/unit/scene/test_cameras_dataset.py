"""Cameras, transforms.json, views.json and reading a dataset."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.cameras import Camera, check_cameras, read_transforms, up_axis, write_transforms
from fipt.scene.dataset import Dataset, read_layers, read_rejected, write_views
from tests import scenes
from tests.layouts import HEIGHT, POSES, WIDTH, matrix, photo


def camera(name: str = "a", split: str = "train", index: int = 0) -> Camera:
    transform = np.array(matrix(POSES[index], (1, 1, 1)))
    return Camera(name, split, WIDTH, HEIGHT, 4.0, 4.5, 3.9, 3.2, transform)


def dataset(root: Path) -> Dataset:
    write_transforms(root / "transforms.json", [camera("a"), camera("b", index=1), camera("c", "val")])
    write_views(root / "views.json", ["a", "b", "c"], {"b": "blurred"})
    for name in "abc":
        write_exr(root / "images" / f"{name}.exr", {"": photo(POSES[0])})
    return Dataset(root)


# --- cameras --------------------------------------------------------------------------------------


def test_project_inverts_directions(np_rng: np.random.Generator) -> None:
    view = camera()
    columns, rows = np_rng.uniform(0, WIDTH, 50), np_rng.uniform(0, HEIGHT, 50)
    d = view.directions(columns, rows)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-6)
    image, depth = view.project(view.center + 3 * d)
    np.testing.assert_allclose(image, np.stack([columns, rows], 1), atol=1e-5)
    assert (depth > 0).all()


def test_resizing_keeps_the_view() -> None:
    view, point = camera(), np.array([[2.5, 1.5, 0.5]])
    before, _ = view.project(point)
    after, _ = view.resized(2 * view.width, 3 * view.height).project(point)
    np.testing.assert_allclose(after, before * [2, 3])


def test_directions_are_right_up_and_ahead() -> None:
    view, pose = camera(), POSES[0]
    np.testing.assert_allclose(view.directions(view.cx, view.cy), pose.forward, atol=1e-6)
    assert view.directions(view.cx + 1, view.cy) @ pose.right > 0
    assert view.directions(view.cx, view.cy + 1) @ pose.up < 0  # rows count downwards


def test_transforms_round_trip(tmp_path: Path) -> None:
    cameras = [camera("a"), camera("b.1", "val", 1)]
    write_transforms(tmp_path / "transforms.json", cameras)
    for before, after in zip(cameras, read_transforms(tmp_path / "transforms.json"), strict=True):
        np.testing.assert_array_equal(after.world_from_camera, before.world_from_camera)
        assert replace(after, world_from_camera=None) == replace(before, world_from_camera=None)


MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ([], "must list at least one frame"),
        ([camera(), camera()], "view names must be unique; a occurs twice"),
        ([camera(split="test")], "split must be train or val; found 'test'"),
        ([replace(camera(), width=0)], "image size and focal lengths must be positive"),
        ([replace(camera(), fx=np.nan)], "image size and focal lengths must be positive"),
        ([replace(camera(), world_from_camera=np.full((4, 4), np.nan))], "4x4 matrix of finite numbers"),
        ([replace(camera(), world_from_camera=MIRRORED)], r"determinant -1\.000 \(a mirrored"),
        ([replace(camera(), world_from_camera=2 * np.eye(4))], "must be orthonormal"),
    ],
)
def test_bad_cameras(cameras: list[Camera], message: str) -> None:
    with pytest.raises(FiptError, match=message):
        check_cameras(cameras, "transforms.json")


def test_names_in_transforms_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    write_transforms(path, [camera()])
    path.write_text(path.read_text().replace("images/a.exr", "images/.a.exr"))
    with pytest.raises(FiptError, match=r"view '\.a' cannot be used as a file name"):
        read_transforms(path)


@pytest.mark.parametrize("text", ["", "[]", '{"frames": 3}', '{"frames": [{}]}', '{"frames": [{"file_path": 1}]}'])
def test_damaged_transforms(tmp_path: Path, text: str) -> None:
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(FiptError, match=r"is not a dataset's transforms\.json"):
        read_transforms(tmp_path / "transforms.json")


# --- dataset --------------------------------------------------------------------------------------


def test_rejected_views_are_not_there(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    assert [view.name for view in data.cameras] == ["a", "c"]
    assert data.views("train") == ["a"]
    assert data.views("val") == ["c"]
    with pytest.raises(FiptError, match="view b is not among the accepted views"):
        data.camera("b")
    assert read_rejected(tmp_path / "views.json") == {"b": "blurred"}


def test_without_views_json_all_are_accepted(tmp_path: Path) -> None:
    assert read_rejected(tmp_path / "views.json") == {}
    (tmp_path / "views.json").write_text('{"views": {"a": {}}}')
    with pytest.raises(FiptError, match=r"is not a views\.json"):
        read_rejected(tmp_path / "views.json")


def test_pixels_without_weight_may_be_anything(tmp_path: Path) -> None:
    data, radiance = dataset(tmp_path), photo(POSES[0])
    radiance[1, 2] = np.nan
    valid = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    valid[1, 2] = 0
    write_exr(tmp_path / "images" / "a.exr", {"": radiance, "valid.Y": valid})
    read, weight = data.image("a")
    assert (read[1, 2] == 0).all()
    np.testing.assert_array_equal(weight, valid)


@pytest.mark.parametrize(("value", "what"), [(np.nan, "NaN"), (np.inf, "infinite"), (-1e-6, "negative")])
def test_bad_pixels_are_counted(tmp_path: Path, value: float, what: str) -> None:
    data, radiance = dataset(tmp_path), photo(POSES[0])
    radiance[1, 2, 0] = radiance[4, 5, 2] = value
    write_exr(tmp_path / "images" / "a.exr", {"": radiance})
    message = rf"a\.exr must hold .*; 2 pixels are {what}, the first at row 1, column 2"
    with pytest.raises(FiptError, match=message):
        data.image("a")


def test_image_size_must_be_the_cameras(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    write_exr(tmp_path / "images" / "a.exr", {"": np.zeros((4, 5, 3))})
    with pytest.raises(FiptError, match=r"a\.exr must be 8x6 like its camera; it is 5x4"):
        data.image("a")


def test_segments(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    assert data.segment_kind() is None
    with pytest.raises(FiptError, match="has no part segments"):
        data.segment_kind("part")
    ids = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH)
    write_png(tmp_path / "segments" / "semantic" / "a.png", ids)
    assert data.segment_kind() == "semantic"
    assert data.segment_kind("none") is None
    np.testing.assert_array_equal(data.segments("a", "semantic"), ids)
    write_png(tmp_path / "segments" / "semantic" / "a.png", ids.T.copy())
    with pytest.raises(FiptError, match="must be 8x6 like its camera; it is 6x8"):
        data.segments("a", "semantic")


def test_layers_round_trip(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    assert data.truth("a") is None
    kd, roughness = photo(POSES[0]), np.full((HEIGHT, WIDTH), 0.3, np.float32)
    write_exr(tmp_path / "truth" / "a.exr", {"kd": kd, "roughness.Y": roughness})
    truth = data.truth("a")
    assert set(truth) == {"kd", "roughness"}
    np.testing.assert_array_equal(truth["kd"], kd)
    np.testing.assert_array_equal(truth["roughness"], roughness)
    write_exr(tmp_path / "b.exr", {"kd.R": roughness})
    with pytest.raises(FiptError, match=r"layer 'kd' lacks kd\.G, kd\.B"):
        read_layers(tmp_path / "b.exr")


def test_transforms_json_is_nerfstudios(tmp_path: Path) -> None:
    dataset(tmp_path)
    frame = json.loads((tmp_path / "transforms.json").read_text())["frames"][0]
    assert set(frame) == {
        "file_path", "split", "w", "h", "fl_x", "fl_y", "cx", "cy", "transform_matrix",
    }  # fmt: skip


def test_the_up_axis_is_an_axis_whatever_the_cameras():
    one = scenes.look_at("a", (0, 0, 0), (0, -0.2, -1))
    two = replace(one, world_from_camera=one.world_from_camera @ np.diag([-1.0, -1, 1, 1]))  # upside down
    np.testing.assert_array_equal(up_axis([one]), [0, 1, 0])
    np.testing.assert_array_equal(up_axis([two]), [0, -1, 0])
    assert np.abs(up_axis([one, two])).sum() == 1  # they cancel: some axis
