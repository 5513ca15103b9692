"""``fipt fuse``: files in, files out, one line where the input is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.scene.dataset import Dataset
from fipt.scene.segments import write_view_ids
from tests.scenes import write_dataset


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    data = Dataset(write_dataset(tmp_path / "dataset"))
    for view in data.views("train"):
        write_view_ids(tmp_path / "segments/views" / f"{view}.npz", data.segments(view, "part"), np.zeros(8, np.int32))
    return tmp_path


def call(root: Path, *more: str) -> int:
    return main(["fuse", "--dataset", str(root / "dataset"), "--segments", str(root / "segments"), *more])


def test_views_become_ids_on_the_mesh(scene: Path, capsys) -> None:
    assert call(scene, "--stats", str(scene / "stats.json")) == 0
    assert "of the votes agree" in capsys.readouterr().err
    written = {str(path.relative_to(scene / "segments")) for path in (scene / "segments").rglob("*") if path.is_file()}
    assert {f"fused/part/{view}.png" for view in "abc"} | {"fusion.npz", "fusion.json", "fused/part.json"} <= written
    assert json.loads((scene / "stats.json").read_text())["parts"] == 7


def test_geometry_needs_no_views(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset")
    assert call(tmp_path, "--geometry") == 0
    assert (tmp_path / "segments/fused/part/c.png").is_file()
    assert json.loads((tmp_path / "segments/fusion.json").read_text())["source"] == "geometry"


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ('{"associate": "classes"}', "fuse.associate is classes, but no view has classes; set fuse.associate"),
        ('{"vote": "loud"}', "fuse.vote"),
        ('{"votes": 3}', "unknown key fuse.votes"),
    ],
)
def test_wrong_settings_are_one_line_and_write_nothing(scene: Path, capsys, settings: str, line: str) -> None:
    assert call(scene, "--settings", settings) == 2
    error = [each for each in capsys.readouterr().err.splitlines() if each.startswith("fipt: error")]
    assert len(error) == 1
    assert line in error[0]
    assert not (scene / "segments/fused").exists()


def test_a_missing_view_is_named(scene: Path, capsys) -> None:
    (scene / "segments/views/b.npz").unlink()
    assert call(scene) == 2
    assert "segments/views/b.npz" in capsys.readouterr().err


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path: Path, capsys) -> None:
    write_dataset(tmp_path / "dataset")
    (tmp_path / "segments").write_text("")
    assert call(tmp_path, "--geometry") == 2
    assert "segments cannot be written: a file stands where a folder must" in capsys.readouterr().err
