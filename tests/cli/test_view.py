"""`fipt view`: every kind of file becomes an image, and what it says where it cannot."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.conventions import SHADING_OUTPUTS, SUB_POSITIONS
from fipt.formats.arrays import save_npz
from fipt.formats.exr import write_exr
from fipt.formats.images import to_display, write_png
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples, write_samples
from fipt.scene.shading import Shading, save_shading
from tests import scenes

View = Callable[..., np.ndarray]


@pytest.fixture
def view(tmp_path: Path) -> View:
    """Run ``fipt view`` and return the image."""

    def run(path: Path, *options: str) -> np.ndarray:
        out = tmp_path / "out.png"
        assert main(["view", str(path), "--out", str(out), *options]) == 0
        with Image.open(out) as image:
            return np.array(image)

    return run


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Hits and shading of a shard with views a (2x2) and b (3 wide, 1 high)."""
    counts = np.array([1, 0, 2, 1, 1, 1, 0])
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    total = int(offsets[-1])
    normal = np.tile(np.array([0, 0, 1], np.float32), (total, 1))
    samples = FootprintSamples(
        views=("a", "b"), shapes=((2, 2), (1, 3)), offsets=offsets,
        center=(counts > 0).astype(np.uint8),
        position=np.arange(3 * total, dtype=np.float32).reshape(total, 3), normal=normal,
        triangle=np.arange(total, dtype=np.int32), footprint=np.ones(total, np.float32),
        weight=np.array([1, 0.75, 0.25, 0.5, 1, 1], np.float32),
        sub=np.zeros((total, SUB_POSITIONS, 3), np.float16),
        sub_triangle=np.zeros((total, SUB_POSITIONS), np.int32),
    )  # fmt: skip
    write_samples(tmp_path / "samples" / "train-000", samples)
    shading = np.zeros((total, SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = np.array([1, 1, 0, 1, 0.5, 0.25])[:, None]
    shading[:, 3] = [2, 0, 0]
    save_shading(tmp_path / "round-0" / "shading" / "train-000", Shading.of(shading))
    return tmp_path


def test_rgb_is_srgb_encoded(tmp_path: Path, view: View) -> None:
    radiance = np.linspace(0, 2, 18, dtype=np.float32).reshape(2, 3, 3)
    write_exr(tmp_path / "a.exr", {"": radiance})
    np.testing.assert_array_equal(view(tmp_path / "a.exr"), to_display(radiance))


def test_layers_of_an_exr(tmp_path: Path, view: View, capsys: pytest.CaptureFixture[str]) -> None:
    layers = {"kd": np.full((2, 3, 3), 0.5), "roughness.Y": np.full((2, 3), 0.5)}
    write_exr(tmp_path / "a.exr", layers)
    both = view(tmp_path / "a.exr")
    assert both.shape == (2, 6, 3)
    assert both[0, 0].tolist() == [188] * 3
    assert both[0, 5].tolist() == [128] * 3  # scalars are linear
    assert "left to right: kd 0.5..0.5, roughness 0.5..0.5" in capsys.readouterr().out
    assert view(tmp_path / "a.exr", "--layer", "roughness").shape == (2, 3, 3)
    assert main(["view", str(tmp_path / "a.exr"), "--layer", "metallic"]) == 2
    assert "has no layer metallic; choose one of kd, roughness" in capsys.readouterr().err


def test_ids_have_false_colours(tmp_path: Path, view: View) -> None:
    ids = np.array([[0, 1, 2], [2, 1, 700]], np.uint16)
    write_png(tmp_path / "a.png", ids)
    write_exr(tmp_path / "IndexMA" / "a.exr", {"": np.repeat(ids[..., None], 3, axis=-1)})
    image = view(tmp_path / "a.png")
    assert image[0, 0].tolist() == [0, 0, 0]
    assert len(np.unique(image.reshape(-1, 3), axis=0)) == 4
    np.testing.assert_array_equal(image, view(tmp_path / "IndexMA" / "a.exr"))


def test_shading_of_a_view(results: Path, view: View) -> None:
    path = results / "round-0" / "shading" / "train-000" / "shading.npy"
    image = view(path)  # Ld of the first view: pixels 1, none, 0.75, 0.5
    assert image.shape == (2, 2, 3)
    values = np.array([[1, 0], [0.75, 0.5]])
    expected = to_display(values / np.percentile(np.repeat(values.ravel(), 3), 98))
    np.testing.assert_allclose(image[..., 0].astype(int), expected, atol=3)
    assert view(path, "--shard-view", "b").shape == (1, 3, 3)
    red = view(path, "--layer", "Ls0.2")
    np.testing.assert_allclose(red[0, 0], [255, 0, 0], atol=1)


def test_samples_elsewhere(results: Path, view: View, capsys: pytest.CaptureFixture[str]) -> None:
    path = results / "round-0" / "shading" / "train-000" / "shading.npy"
    moved = path.rename(results / "shading.npy")
    assert view(moved, "--samples", str(results / "samples" / "train-000")).shape == (2, 2, 3)
    save_shading(results, Shading.empty(2))
    assert main(["view", str(moved), "--samples", str(results / "samples" / "train-000")]) == 2
    assert "name the samples folder it was made from with --samples" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "first", "missed"),
    [
        ("normal", [128, 128, 255], [128, 128, 128]),
        ("weight", [255] * 3, [0] * 3),
        ("center", [255] * 3, [0] * 3),
        ("offsets", [128] * 3, [0] * 3),
        ("footprint", [255] * 3, [0] * 3),
        ("triangle", None, [0] * 3),
        ("position", [0] * 3, None),
    ],
)
def test_arrays_of_a_samples_folder(
    results: Path, view: View, name: str, first: list[int] | None, missed: list[int] | None
) -> None:
    image = view(results / "samples" / "train-000" / f"{name}.npy", "--shard-view", "a")
    assert image.shape == (2, 2, 3)
    assert first is None or image[0, 0].tolist() == first
    assert missed is None or image[0, 1].tolist() == missed
    assert image.any()


def test_npz_files_become_a_table(tmp_path: Path, view: View, capsys: pytest.CaptureFixture[str]) -> None:
    save_npz(
        tmp_path / "emitters.npz",
        triangle=np.arange(3, dtype=np.int32), emitter=np.array([0, 0, 1], np.int32),
        radiance=np.array([[1, 2, 3], [3, 2, 1], [5, 5, 5]], np.float32),
        area=np.array([0.25, 0.25, 2.0], np.float32),
    )  # fmt: skip
    assert view(tmp_path / "emitters.npz").std() > 0
    out = capsys.readouterr().out
    assert "emitters.npz: 4 arrays" in out
    assert "2 emitters" in out
    assert "   0      2   0.5000    2.000    2.000    2.000" in out
    save_npz(tmp_path / "cache.npz", key=np.arange(5), empty=np.zeros((0, 3)))
    view(tmp_path / "cache.npz")
    assert "0 .. 2 .. 4" in capsys.readouterr().out


def test_default_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_exr(tmp_path / "val_000.exr", {"kd": np.zeros((2, 2, 3))})
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert main(["view", "../val_000.exr", "--layer", "kd"]) == 0
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["val_000.kd.png"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.exr"], "the file to view is missing: none.exr"),
        (["samples/train-000/views.json"], "cannot be viewed; give a file .exr, .png, .npy, .npz"),
        (["samples/train-000/sub.npy"], "sub.npy cannot be viewed; give shading.npy, position"),
        (["samples/train-000/normal.npy", "--shard-view", "x"], "no view x; choose one of a, b"),
        (
            ["round-0/shading/train-000/shading.npy", "--layer", "Ls"],
            "has no layer Ls; choose one of Ld, Ls0.0, Ls0.1",
        ),
    ],
)
def test_what_cannot_be_viewed(
    results: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(results)
    assert main(["view", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_dataset_is_shown_as_a_row_for_each_view(view, tmp_path, capsys):
    scenes.write_dataset(tmp_path / "dataset")
    names = [camera.name for camera in Dataset(tmp_path / "dataset").cameras]
    pixels = view(tmp_path / "dataset")
    said = capsys.readouterr().out
    assert f"rows: {', '.join(names)}; columns: image" in said
    camera = Dataset(tmp_path / "dataset").camera(names[0])
    columns = said.partition("columns: ")[2].partition(";")[0].split(", ")
    assert pixels.shape == (len(names) * camera.height, len(columns) * camera.width, 3)
    one = view(tmp_path / "dataset", "--views", names[1])
    # The exposure is that of what is shown; ids and numbers look the same.
    last = slice((len(columns) - 1) * camera.width, None)
    np.testing.assert_array_equal(one[:, last], pixels[camera.height : 2 * camera.height, last])
    assert main(["view", str(tmp_path / "dataset"), "--views", "nobody"]) == 2
    assert "nobody is not among the accepted views" in capsys.readouterr().err
