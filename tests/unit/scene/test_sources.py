"""Names and splits of sources, and the directions their cameras look in."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.sources import read_source
from tests.layouts import POSES, WRITERS, matrix, write_blender, write_nerfstudio


def source_views(*args, **kwargs) -> list[tuple[str, str]]:
    return [(frame.name, frame.split) for frame in read_source(*args, **kwargs).frames]


def rewrite(path: Path, **keys: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **keys}))


def test_needs_the_standard_library_only() -> None:
    code = (
        "import sys, fipt.scene.sources; "
        "print([m for m in ('numpy', 'pydantic', 'OpenEXR', 'trimesh') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("format", "views"),
    [
        ("nerfstudio", [("view_0", "val"), ("view_1", "train"), ("view_2", "val")]),
        ("fipt-synthetic", [("train_000", "train"), ("train_001", "train"), ("val_000", "val")]),
        ("fipt-real", [("000", "val"), ("001", "train"), ("002", "val")]),
    ],
)
def test_names_and_splits(tmp_path: Path, format: str, views: list[tuple[str, str]]) -> None:
    WRITERS[format](tmp_path)
    assert source_views(tmp_path, format, val_every=2) == views


@pytest.mark.parametrize("format", WRITERS)
def test_every_layout_gives_opengl_cameras(tmp_path: Path, format: str) -> None:
    WRITERS[format](tmp_path)
    for frame, pose in zip(read_source(tmp_path, format).frames, POSES, strict=True):
        np.testing.assert_allclose(frame.world_from_camera, matrix(pose, (1, 1, 1)), atol=1e-7)


def test_look_at_up_needs_not_be_square(tmp_path: Path) -> None:
    WRITERS["fipt-real"](tmp_path)
    lines = (tmp_path / "cam.txt").read_text().splitlines()
    lines[3::3] = ["0 1 0"] * len(POSES)
    (tmp_path / "cam.txt").write_text("\n".join(lines))
    for frame, pose in zip(read_source(tmp_path, "fipt-real").frames, POSES, strict=True):
        np.testing.assert_allclose(frame.world_from_camera, matrix(pose, (1, 1, 1)), atol=1e-7)


def test_blender_splits_are_numbered_separately(tmp_path: Path) -> None:
    write_blender(tmp_path)
    source = read_source(tmp_path, "nerfstudio")
    assert [(frame.name, frame.split) for frame in source.frames] == [
        ("train_r_0", "train"), ("train_r_1", "train"), ("val_r_0", "val"),
    ]  # fmt: skip
    assert source.frames[2].image == tmp_path / "val" / "r_0.exr"


def test_split_key_of_frames(tmp_path: Path) -> None:
    content = write_nerfstudio(tmp_path)
    for frame, split in zip(content["frames"], ("train", "val", "train"), strict=True):
        frame["split"] = split
    rewrite(tmp_path / "transforms.json", frames=content["frames"])
    assert [split for _, split in source_views(tmp_path, "nerfstudio")] == ["train", "val", "train"]


def test_lists_of_file_names(tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, train_filenames=["images/view_2.exr"], val_filenames=["images/view_0.exr"])
    assert source_views(tmp_path, "nerfstudio") == [("view_0", "val"), ("view_2", "train")]


def test_a_list_that_names_no_frame(tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, train_filenames=["images/other.exr"], val_filenames=[])
    with pytest.raises(FiptError, match=r"a split lists images/other\.exr, which no frame has"):
        source_views(tmp_path, "nerfstudio")


def test_numbers_without_the_suffix_0001(tmp_path: Path) -> None:
    WRITERS["fipt-real"](tmp_path)
    for path in (tmp_path / "Image").iterdir():
        path.rename(path.with_name(path.name.replace("_0001", "")))
    assert read_source(tmp_path, "fipt-real").frames[1].image == tmp_path / "Image" / "001.exr"


def test_the_file_itself_may_be_the_source(tmp_path: Path) -> None:
    write_nerfstudio(tmp_path)
    path = tmp_path / "transforms.json"
    assert read_source(path, "nerfstudio").mesh == tmp_path / "mesh.ply"
    assert len(source_views(path, "nerfstudio")) == 3


def test_intrinsics_of_a_frame_win(tmp_path: Path) -> None:
    content = write_nerfstudio(tmp_path)
    content["frames"][1]["fl_x"] = 7.5
    rewrite(tmp_path / "transforms.json", frames=content["frames"])
    frames = read_source(tmp_path, "nerfstudio").frames
    assert [frame.intrinsics["fl_x"] for frame in frames] == [4.0, 7.5, 4.0]
