"""`fipt depth`: what it writes, and one line and exit code 2 for views that tell no depth."""

import json
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.conventions import FLAG_SATURATED
from fipt.formats.exr import read_exr, write_exr
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.depth_maps import read_depth_map
from fipt.stages.geometry.stereo_view import stereo_view
from tests.unit.stages.geometry.test_depth import HEIGHT, WIDTH, camera, seen


def write_dataset(root: Path, cameras: list[Camera]) -> None:
    """A dataset without a mesh: views of two slanted planes."""
    for taken in cameras:
        light, _, _ = seen(taken)
        write_exr(root / "images" / f"{taken.name}.exr", {"": np.repeat(np.exp(light.light)[..., None], 3, axis=2)})
    write_transforms(root / "transforms.json", cameras)
    write_views(root / "views.json", [taken.name for taken in cameras])


def test_writes_a_map_of_every_training_view(tmp_path: Path) -> None:
    cameras = [camera(f"v{i}", 0.15 * i, 0.1 * (i % 2)) for i in range(4)]
    write_dataset(tmp_path / "dataset", cameras)
    arguments = ["depth", "--dataset", str(tmp_path / "dataset"), "--out", str(tmp_path / "depth")]
    settings = ("--settings", json.dumps({"nearest": 1.0}))  # the planes are farther away
    assert main([*arguments, *settings, "--stats", str(tmp_path / "stats.json")]) == 0
    listed = json.loads((tmp_path / "depth.manifest.json").read_text())["files"]
    assert set(listed) == {f"depth/v{i}.exr" for i in range(4)}
    _, depth, _ = seen(cameras[1])
    found = read_depth_map(tmp_path / "depth" / "v1.exr")
    assert found.known.mean() > 0.5
    assert np.median(np.abs(found.depth / depth - 1)[found.known]) < 0.005
    assert json.loads((tmp_path / "stats.json").read_text())["views"] == 4


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ([camera(f"v{i}", 0.001 * i, turn=8.0 * i) for i in range(5)], "as in a panorama"),
        ([camera("a", 0.0), camera("b", 0.3)], "at least 3 views"),
        ([camera("a", 0.0), camera("b", 0.3), camera("c", 0.0, turn=180.0)], "0 of 3 overlap with two others"),
    ],
    ids=["panorama", "two views", "apart"],
)
def test_views_that_tell_no_depth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cameras: list[Camera], message: str
) -> None:
    write_dataset(tmp_path / "dataset", cameras)
    assert main(["depth", "--dataset", str(tmp_path / "dataset"), "--out", str(tmp_path / "depth")]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("fipt: error: ")]
    assert message in line
    assert not (tmp_path / "depth").exists()


def test_memory_is_refused_before_it_is_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_dataset(tmp_path / "dataset", [camera(f"v{i}", 0.15 * i) for i in range(3)])
    settings = json.dumps({"memory_gb": 1e-6})
    arguments = ["depth", "--dataset", str(tmp_path / "dataset"), "--out", str(tmp_path / "depth")]
    assert main([*arguments, "--settings", settings]) == 2
    assert "depth of 3 views needs about" in capsys.readouterr().err


def test_saturated_pixels_count_for_nothing(tmp_path: Path) -> None:
    write_dataset(tmp_path, [camera("a", 0.0)])
    path = tmp_path / "images" / "a.exr"
    flags = np.zeros((HEIGHT, WIDTH), np.float32)
    flags[3:5, 7:9] = FLAG_SATURATED
    write_exr(path, read_exr(path) | {"flags.Y": flags})
    view = stereo_view(Dataset(tmp_path), "a")
    assert np.array_equal(np.isnan(view.light), flags > 0)
    assert np.isnan(view.halved().light).sum() == 0  # half of the four count
