"""`fipt import`: what it prints, and one line and exit code 2 for every bad input."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.dataset import Dataset
from tests.layouts import (
    HEIGHT,
    POSES,
    WIDTH,
    WRITERS,
    photo,
    room,
    write_blender,
    write_obj,
)  # fmt: skip


def edit(path: Path, change: Callable[[dict], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def transforms(change: Callable[[dict], object]) -> Callable[[Path], None]:
    return lambda root: edit(root / "transforms.json", change)


def frame(index: int, **keys: object) -> Callable[[Path], None]:
    return transforms(lambda content: content["frames"][index].update(keys))


def image(name: str, values: np.ndarray | None, **channels: np.ndarray) -> Callable[[Path], None]:
    layers = channels if values is None else {"": values, **channels}
    return lambda root: write_exr(root / name, layers)


def pixels(value: float, count: int) -> np.ndarray:
    radiance = photo(POSES[1])
    radiance[0, :count, 1] = value
    return radiance


def lines(name: str, change: Callable[[list[str]], object]) -> Callable[[Path], None]:
    def run(root: Path) -> None:
        content = (root / name).read_text().splitlines()
        change(content)
        (root / name).write_text("\n".join(content) + "\n")

    return run


def remove(name: str) -> Callable[[Path], None]:
    return lambda root: (root / name).unlink()


VIEW = "images/view_1.exr"
SCALED = np.diag([2.0, 2, 2, 1]).tolist()
MIRRORED = np.diag([-1.0, 1, 1, 1]).tolist()
N, S, R = WRITERS
EMPTY = np.zeros((HEIGHT, WIDTH))
BAD: list[tuple[str, Callable[[Path], object], str]] = [
    # cameras
    (N, remove("transforms.json"), "must hold transforms.json, or transforms_train"),
    (N, lambda root: (root / "transforms.json").write_text("{"), "is not JSON"),
    (N, transforms(lambda c: c.pop("frames")), "is not a transforms.json with frames"),
    (N, transforms(lambda c: c["frames"].clear()), "must list at least one frame"),
    (N, transforms(lambda c: c["frames"][1].pop("file_path")), "frame 1 is malformed"),
    (N, frame(1, transform_matrix=[[1, 2]]), "frame 1 is malformed"),
    (N, frame(1, transform_matrix=SCALED), "view view_1: the rotation must be orthonormal"),
    (N, frame(1, transform_matrix=MIRRORED), "a mirrored or scaled camera"),
    (N, frame(1, fl_x=-3), "fl_x must be a finite number above 0; found -3"),
    (N, frame(1, cx=-300), "the principal point must lie within 10 sizes of the image; found -300, 3 of 8x6"),
    (N, frame(1, w="wide"), "frame 1 is malformed"),
    (N, transforms(lambda c: (c.pop("fl_x"), c.pop("fl_y"))),
     "view view_0: the focal length must be known"),
    (N, transforms(lambda c: c.update(k1=0.02)),
     "lens distortion must be zero; found k1 = 0.02; undistort the images first"),
    (N, frame(1, p2=1e-4), "frame 1: lens distortion must be zero; found p2"),
    (N, transforms(lambda c: c.update(camera_model="OPENCV_FISHEYE")),
     "must be pinholes; found OPENCV_FISHEYE"),
    (N, frame(1, split="test"), "split must be train or val"),
    (N, transforms(lambda c: [f.update(split="val") for f in c["frames"]]),
     "must have at least one train view"),
    (S, remove("val/transforms.json"), "the camera file is missing"),
    (R, remove("cam.txt"), "the camera list is missing"),
    (R, remove("K_list.txt"), "the camera list is missing"),
    (R, lines("cam.txt", lambda c: c.pop()),
     "cam.txt must hold 3 lines of three numbers for each of 3 cameras; it holds 8 lines"),
    (R, lines("cam.txt", lambda c: c.__setitem__(2, "1 x 2")),
     "cam.txt must hold a count, then lines of three numbers"),
    (R, lines("cam.txt", lambda c: c.clear()),
     "cam.txt must hold a count, then lines of three numbers"),
    (R, lines("K_list.txt", lambda c: (c.__setitem__(0, "2"), c.__delitem__(slice(7, None)))),
     "must hold as many cameras; found 3 and 2"),
    (R, lines("cam.txt", lambda c: c.__setitem__(2, c[1])),
     "camera 0: origin, look-at point and up must span a camera"),
    (R, lines("K_list.txt", lambda c: c.__setitem__(1, "4 0.5 4")),
     "camera 0: skew must be zero"),
    # names
    (N, frame(1, file_path="images/view_0.exr"),
     "view names must be unique; view_0 occurs twice"),
    (N, frame(1, file_path="images/.."), "view '..' cannot be used as a file name"),
    (N, frame(1, file_path="images/..\\up.exr"), "cannot be used as a file name"),
    (N, frame(1, file_path="images/.hidden.exr"), "view '.hidden' cannot be used as a file name"),
    (N, frame(1, file_path=""), "view '' cannot be used as a file name"),
    # images
    (N, remove(VIEW), "every frame must have an image; 1 have none, the first is view view_1"),
    (S, remove("val/Image/000_0001.exr"), "the first is view val_000"),
    (R, remove("Image/002_0001.exr"), "the first is view 002"),
    (N, frame(1, file_path="images/view_1.png"),
     "images must be EXR files with linear radiance; found images/view_1.png"),
    (N, image(VIEW, np.zeros((HEIGHT, WIDTH + 1, 3))),
     "view_1.exr must be 8x6 like its camera; it is 9x6"),
    (N, image(VIEW, pixels(np.nan, 3)),
     "view_1.exr must hold finite radiance >= 0; 3 pixels are NaN"),
    (N, image(VIEW, pixels(np.inf, 2)), "2 pixels are infinite"),
    (N, image(VIEW, pixels(-0.5, 1)), "1 pixels are negative, the first at row 0, column 0"),
    (N, image(VIEW, None, Y=EMPTY), "must have the channels R, G, B; R, G, B not among Y"),
    (N, lambda root: (root / VIEW).write_text("no image"), "is not a readable EXR file"),
    (N, frame(1, mask_path="mask.png"), "the mask of a frame is missing"),
    # mesh
    (N, remove("mesh.ply"), "has no mesh.ply; name the room's mesh with --mesh, or --mesh none for views alone"),
    (R, remove("scene.obj"), "the mesh is missing"),
    (R, lambda root: (root / "scene.obj").write_text(""), "must hold triangles; it has none"),
    (R, lines("scene.obj", lambda c: c.__setitem__(2, "v nan 0 0")),
     "1 are NaN or infinite, the first is vertex 2"),
    # truth and ids
    (S, remove("train/Roughness/001_0001.exr"), "an EXR file is missing"),
    (S, image("train/DiffCol/001_0001.exr", np.zeros((2, 2, 3))),
     "must be 8x6 like the image; it is 2x2"),
    (S, image("train/albedo/001.exr", pixels(np.nan, 2)),
     "albedo/001.exr must hold finite values >= 0; 2 are not"),
    (S, image("val/Emit/000_0001.exr", None, Z=EMPTY), "must have the channels R, G, B"),
    (S, image("val/IndexMA/000_0001.exr", np.full((HEIGHT, WIDTH, 3), 1.5)),
     "must hold whole ids from 0 to 65535; 48 pixels do not, such as 1.5"),
    (R, image("segmentation/000.exr", np.full((HEIGHT, WIDTH, 3), 70_000)),
     "must hold whole ids from 0 to 65535"),
    (R, image("segmentation/000.exr", None, G=EMPTY, B=EMPTY), "must have a channel R or Y"),
    (S, lambda root: (root / "meta.json").write_text('{"materials": 3}'),
     "meta.json must list materials with names"),
]  # fmt: skip


@pytest.mark.parametrize(("format", "spoil", "message"), BAD, ids=[message for *_, message in BAD])
def test_bad_input_gets_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    format: str,
    spoil: Callable[[Path], object],
    message: str,
) -> None:
    source = tmp_path / "source"
    source.mkdir()
    WRITERS[format](source)
    spoil(source)
    arguments = ["--source", str(source), "--format", format, "--dataset", str(tmp_path / "out")]
    assert main(["import", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fipt: error: ")
    assert message in line
    assert [path.name for path in tmp_path.iterdir()] == ["source"]


def call(source: Path, format: str, dataset: Path, *more: str) -> int:
    return main(["import", "--source", str(source), "--format", format, "--dataset", str(dataset), *more])


@pytest.mark.parametrize(
    ("format", "more", "message"),
    [
        ("colmap", [], "unknown format 'colmap'; choose one of nerfstudio, fipt-synthetic, fipt-"),
        ("nerfstudio", ["--settings", '{"val_evry": 2}'], "unknown key import.val_evry"),
        ("nerfstudio", ["--settings", '{"val_every": 0}'], "import.val_every"),
        ("nerfstudio", ["--settings", '{"val_every": 1}'], "raise import.val_every"),
        ("nerfstudio", ["--mesh", "none.ply"], "the mesh is missing: none.ply"),
        ("nerfstudio", ["--manifest", "elsewhere/m.json"], "must lie in the dataset"),
    ],
)  # fmt: skip
def test_bad_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], format: str, more: list[str], message: str
) -> None:
    WRITERS["nerfstudio"](tmp_path / "source")
    assert call(tmp_path / "source", format, tmp_path / "out", *more) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_source_must_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(tmp_path / "none", "nerfstudio", tmp_path / "out") == 2
    assert f"the source {tmp_path / 'none'} does not exist" in capsys.readouterr().err


def test_format_is_required(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "--source", str(tmp_path), "--dataset", str(tmp_path / "out")]) == 2
    assert "--format" in capsys.readouterr().err


def test_folders_that_are_no_dataset_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, other = tmp_path / "source", tmp_path / "other"
    WRITERS["nerfstudio"](source)
    for target, message in (
        (source, "must not hold its source"),
        (tmp_path, "must not hold its source"),
        (other, "exists and is not a dataset (it holds transforms.json)"),
        (tmp_path / "home", "exists and is not a dataset (it holds diary.txt)"),
        (source / "mesh.ply", "is a file"),
    ):
        if target == other:
            WRITERS["nerfstudio"](other)
        if target.name == "home":
            target.mkdir()
            (target / "diary.txt").touch()
        before = sorted(target.rglob("*"))
        assert call(source, "nerfstudio", target) == 2
        assert message in capsys.readouterr().err
        assert sorted(target.rglob("*")) == before


def test_a_principal_point_outside_is_told_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Crops have it there: the import goes on."""
    WRITERS["nerfstudio"](tmp_path / "source")
    frame(1, cx=-3)(tmp_path / "source")
    assert call(tmp_path / "source", "nerfstudio", tmp_path / "out", "--mesh", "none") == 0
    assert "warning: the principal points of 1 of 3 cameras lie outside the image (view_1)" in capsys.readouterr().err


def test_views_alone_need_no_mesh(tmp_path: Path) -> None:
    WRITERS["nerfstudio"](tmp_path / "source")
    assert call(tmp_path / "source", "nerfstudio", tmp_path / "with") == 0
    remove("mesh.ply")(tmp_path / "source")
    assert call(tmp_path / "source", "nerfstudio", tmp_path / "out", "--mesh", "none") == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "images",
        "import.manifest.json",
        "transforms.json",
        "views.json",
    }
    one, other = Dataset(tmp_path / "with"), Dataset(tmp_path / "out")
    for view in one.views("train"):
        assert np.array_equal(one.image(view)[0], other.image(view)[0])


def test_a_distorted_mask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    WRITERS["nerfstudio"](tmp_path / "source")
    frame(1, mask_path="mask.png")(tmp_path / "source")
    write_png(tmp_path / "source" / "mask.png", np.zeros((3, 4), np.uint8))
    assert call(tmp_path / "source", "nerfstudio", tmp_path / "out") == 2
    assert "mask.png must be 8x6 like its image; it is 4x3" in capsys.readouterr().err


def test_success_in_a_process_of_its_own(tmp_path: Path) -> None:
    write_blender(tmp_path / "source")
    (tmp_path / "source" / "mesh.ply").unlink()
    write_obj(tmp_path / "room.obj", room())
    arguments = [
        sys.executable, "-m", "fipt.cli.main", "import", "--source", "source",
        "--format", "nerfstudio", "--dataset", "results/room/dataset", "--mesh", "room.obj",
        "--stats", "results/room/stats/import.json",
    ]  # fmt: skip
    root = Path(__file__).parents[4]
    done = subprocess.run(
        arguments, cwd=tmp_path, env={"PYTHONPATH": str(root)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert "results/room/dataset: 2 train and 1 val views\n" in done.stderr
    assert "import: 3 views in" in done.stderr
    folder = tmp_path / "results" / "room"
    assert json.loads((folder / "stats" / "import.json").read_text())["views"] == 3
    assert len(Dataset(folder / "dataset").cameras) == 3
    with Image.open(folder / "dataset" / "overlay.png") as overlay:
        assert overlay.size == (960, 720)


def test_a_failure_in_a_process_of_its_own(tmp_path: Path) -> None:
    root = Path(__file__).parents[4]
    done = subprocess.run(
        [sys.executable, "-m", "fipt.cli.main", "import", "--source", str(tmp_path / "none"),
         "--format", "fipt-real", "--dataset", str(tmp_path / "out")],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (f"fipt: error: the source {tmp_path / 'none'} does not exist; check the path\n")
