"""Depth maps that exist: read, checked through the cameras, given normals."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.conventions import FLAG_MOVED, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.depth_maps import DepthMap, read_depth_map
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.given_depth import given_maps
from fipt.stages.geometry.settings import given_file
from fipt.stages.geometry.stereo_view import StereoView
from tests.unit.stages.geometry.test_fusing import around, cube_through

VIEWS = around(0.003)[:4]


def write(folder: Path, scale: float = 1000.0, exr: bool = False, views: Sequence[DepthView] = VIEWS) -> Path:
    for view in views:
        if exr:
            write_exr(folder / f"{view.camera.name}.exr", {"Z": view.map.depth})
        else:
            folder.mkdir(exist_ok=True)
            write_png(folder / f"{view.camera.name}.png", (view.map.depth * scale).astype(np.uint16))
    return folder


def read(folder: Path, unit: float = 0.001, views: Sequence[DepthView] = VIEWS) -> list[tuple[str, DepthMap]]:
    light = [StereoView(view.camera, np.zeros(view.map.depth.shape, np.float32), 0.0) for view in views]
    shown = [np.ones(view.map.depth.shape, bool) for view in views]
    files = {view.camera.name: given_file(folder, view.camera.name) for view in views}
    return list(given_maps(light, shown, files, unit))


def with_depth(view: DepthView, where: tuple[slice, slice], depth: float) -> DepthView:
    """The view with another depth in a part of its map."""
    changed = view.map.depth.copy()
    changed[where] = depth
    return view.with_map(replace(view.map, depth=changed))


@pytest.mark.parametrize("exr", [True, False], ids=["exr", "png"])
def test_depth_comes_with_normals(tmp_path, exr):
    for view, (name, found) in zip(VIEWS, read(write(tmp_path / "depth", exr=exr)), strict=True):
        assert name == view.camera.name
        assert found.known.mean() > 0.95
        np.testing.assert_allclose(found.depth[found.known], view.map.depth[found.known], atol=0.001)
        cosine = (found.normal * view.map.normal).sum(axis=-1)[found.known]
        assert np.degrees(np.arccos(np.minimum(np.median(cosine), 1))) < 3


def test_a_depth_camera_is_noisy_near_by(tmp_path):
    rng = np.random.default_rng(3)
    (tmp_path / "depth").mkdir()
    for view in VIEWS:
        noisy = 1000 * (view.map.depth + rng.normal(0, 0.01, view.map.depth.shape))
        write_png(tmp_path / "depth" / f"{view.camera.name}.png", noisy.astype(np.uint16))
    for view, (_, found) in zip(VIEWS, read(tmp_path / "depth"), strict=True):
        assert found.known.mean() > 0.95
        cosine = (found.normal * view.map.normal).sum(axis=-1)[found.known]
        assert np.degrees(np.arccos(np.minimum(np.median(cosine), 1))) < 6


def write_layout(folder: Path) -> Path:
    """A nerfstudio folder that names depth maps, and a dataset of its views."""
    cameras = [view.camera for view in VIEWS]
    for root in (folder / "rgbd", folder / "dataset"):
        for camera in cameras:
            write_exr(root / "images" / f"{camera.name}.exr", {"": np.full((60, 80, 3), 0.5, np.float32)})
        write_transforms(root / "transforms.json", cameras)
    write_views(folder / "dataset" / "views.json", [camera.name for camera in cameras])
    write(folder / "rgbd" / "sensor")
    path = folder / "rgbd" / "transforms.json"
    content = json.loads(path.read_text())
    for frame, camera in zip(content["frames"], cameras, strict=True):
        frame["depth_file_path"] = f"sensor/{camera.name}.png"
    path.write_text(json.dumps(content))
    return path


def test_a_layout_names_depth_maps(tmp_path):
    path = write_layout(tmp_path)
    depth = ["depth", "--dataset", str(tmp_path / "dataset"), "--out", str(tmp_path / "depth")]
    assert main([*depth, "--layout", str(path)]) == 0
    found = read_depth_map(tmp_path / "depth" / f"{VIEWS[2].camera.name}.exr")
    np.testing.assert_allclose(found.depth[found.known], VIEWS[2].map.depth[found.known], atol=0.001)

    content = json.loads(path.read_text())
    del content["frames"][1]["depth_file_path"]
    path.write_text(json.dumps(content))
    assert main([*depth, "--layout", str(path)]) == 2


def test_smaller_maps_are_taken_over(tmp_path):
    folder = write(tmp_path / "depth")
    small = VIEWS[0].map.depth[::2, ::2]
    write_png(folder / f"{VIEWS[0].camera.name}.png", (small * 1000).astype(np.uint16))
    found = read(folder)[0][1]
    assert np.median(np.abs(found.depth - VIEWS[0].map.depth)) < 0.02


@pytest.mark.parametrize("factor", [4, 8])
def test_maps_smaller_than_their_view_go_on_between_their_pixels(tmp_path: Path, factor: int) -> None:
    views = [cube_through(view.camera.resized(320, 240)) for view in VIEWS]
    small = [cube_through(view.camera.resized(320 // factor, 240 // factor)) for view in views]
    angles, errors = [], []
    for view, (_, found) in zip(views, read(write(tmp_path, exr=True, views=small), views=views), strict=True):
        assert found.known.mean() > 0.9
        cosine = (found.normal * view.map.normal).sum(axis=-1)[found.known]
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        errors.append(np.abs(found.depth - view.map.depth)[found.known])
    assert np.median(np.concatenate(angles)) < 1
    assert np.quantile(np.concatenate(angles), 0.9) < 3
    assert np.median(np.concatenate(errors)) < 0.0005


def test_what_is_masked_takes_no_part(tmp_path: Path) -> None:
    """A tripod that all photographs show, masked; a lamp too bright for them keeps its depth."""
    write_layout(tmp_path)
    rig, emitter, moved = np.s_[40:, 30:50], np.s_[5:10, 5:10], np.s_[20:25, 60:65]
    valid, flags = np.ones((60, 80), np.float32), np.zeros((60, 80), np.float32)
    valid[rig], flags[emitter] = 0, FLAG_SATURATED
    flags[moved], flags[:, 79] = FLAG_MOVED, FLAG_OUTSIDE
    for view in VIEWS:
        path = tmp_path / "dataset" / "images" / f"{view.camera.name}.exr"
        write_exr(path, {"": np.full((60, 80, 3), 0.5, np.float32), "valid.Y": valid, "flags.Y": flags})
    given = write(tmp_path / "given", exr=True, views=[with_depth(view, rig, 0.4) for view in VIEWS])
    depth = ["depth", "--dataset", str(tmp_path / "dataset"), "--out", str(tmp_path / "depth")]
    assert main([*depth, "--settings", json.dumps({"given": str(given)})]) == 0
    for view in VIEWS:
        found = read_depth_map(tmp_path / "depth" / f"{view.camera.name}.exr")
        assert not found.known[rig].any()
        assert not found.known[moved].any()
        assert not found.known[:, 79].any()
        assert not found.normal[rig].any()
        assert found.known[emitter].mean() > 0.9
        # windows beside the mask are fitted without it
        assert found.known[36:40, 30:50].mean() > 0.9
        np.testing.assert_allclose(found.depth[found.known], view.map.depth[found.known], rtol=1e-5)


@pytest.mark.parametrize("far", [1e10, 65504.0], ids=["Blender", "half float"])
def test_what_a_renderer_writes_where_nothing_is_is_unknown(tmp_path: Path, far: float) -> None:
    window = np.s_[10:30, 20:50]
    views = [with_depth(view, window, far) for view in VIEWS]
    for _, found in read(write(tmp_path, exr=True, views=views)):
        assert not found.known[window].any()
        assert found.depth.max() < 10
        assert found.known.mean() > 0.7


def test_where_nothing_is_agrees_with_nothing(tmp_path: Path) -> None:
    """Most pixels show the open sky; the others are in millimetres."""
    views = []
    for view in VIEWS:
        millimetres = view.with_map(replace(view.map, depth=1000 * view.map.depth))
        views.append(with_depth(millimetres, np.s_[:40, :], 1e10))
    with pytest.raises(FiptError, match="depth is 1000 times too large"):
        read(write(tmp_path, exr=True, views=views))


def test_one_view_with_depth_is_held_against_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ((_, found),) = read(write(tmp_path, exr=True, views=VIEWS[:1]), views=VIEWS[:1])
    assert found.known.mean() > 0.95
    assert f"{VIEWS[0].camera.name} alone has depth" in caplog.text


@pytest.mark.parametrize(
    ("count", "changed", "said"),
    [
        (4, lambda depth: 0 * depth, "must hold depth; it is 0 or not finite"),
        (4, lambda depth: 0 * depth + 1e10, "beyond 1000 m, the nearest at 1e\\+10 m.*depth.unit"),
        (1, lambda depth: 1000 * depth, "beyond 1000 m, the nearest at 1[0-9]{3} m.*depth.unit"),
    ],
    ids=["zeros", "nothing but background", "one view in millimetres"],
)
def test_maps_without_depth_of_a_room_are_refused(tmp_path: Path, count, changed, said) -> None:
    views = [view.with_map(replace(view.map, depth=changed(view.map.depth))) for view in VIEWS[:count]]
    with pytest.raises(FiptError, match=said):
        read(write(tmp_path, exr=True, views=views), views=views)


def test_views_that_show_nothing_of_each_other_are_refused(tmp_path: Path) -> None:
    back_to_back = [around()[0], around()[4]]
    with pytest.raises(FiptError, match="no view shows surface of another"):
        read(write(tmp_path, exr=True, views=back_to_back), views=back_to_back)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"scale": 500.0}, "other views confirm"),
        ({"scale": 10_000.0}, "depth is 10 times too large"),
    ],
    ids=["no unit", "another unit"],
)
def test_another_unit_is_refused(tmp_path, wrong, said):
    with pytest.raises(FiptError, match=said):
        read(write(tmp_path / "depth", **wrong))


def test_another_room_is_refused(tmp_path):
    folder = write(tmp_path / "depth")
    for view in VIEWS:
        noise = np.random.default_rng(len(view.camera.name)).uniform(300, 5000, (60, 80))
        write_png(folder / f"{view.camera.name}.png", noise.astype(np.uint16))
    with pytest.raises(FiptError, match="check that they are of these views"):
        read(folder)


def test_what_is_no_depth_map_is_refused(tmp_path):
    folder = write(tmp_path / "depth")
    path = folder / f"{VIEWS[0].camera.name}.png"
    write_png(path, np.zeros((60, 80), np.uint8))
    with pytest.raises(FiptError, match="16 bits"):
        read(folder)
    write_png(path, np.zeros((60, 60), np.uint16))
    with pytest.raises(FiptError, match="shape of its view, 80x60"):
        read(folder)
    path.unlink()
    with pytest.raises(FiptError, match="is missing"):
        read(folder)
