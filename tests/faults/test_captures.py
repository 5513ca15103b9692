"""Captures are not trusted: covered exposures, exposures that lie, and calibration frames of something else."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.stages.capture.brackets import Bracket, _left_out, judge, read_capture
from fipt.stages.capture.folder import others, photographs
from fipt.stages.capture.quality import _gathered
from fipt.stages.capture.raw import Shot, _usual
from tests import captures
from tests.faults.faults import Fault, named, refused


def said_of(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    main(["check-capture", str(folder)])
    return " ".join(capsys.readouterr().out.split())


def test_board_frames_as_flats_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = captures.write(tmp_path / "raw")
    for path in made.calibration("flat"):
        path.unlink()
    for path in made.calibration("checkerboard")[:3]:
        shutil.copy(path, made.folder / "calibration" / "flat")
    refused(capsys, "check-capture", str(made.folder))
    assert "must be" in (said := said_of(made.folder, capsys))
    assert "error: " in said
    assert "/flat/" in said


def test_a_covered_exposure_is_told() -> None:
    rng = np.random.default_rng(0)
    scene = rng.uniform(0.05, 0.9, (40, 50)).astype(np.float32)
    exposures = [1.0, 0.25, 0.0625]
    greens = [scene * np.float32(exposure) for exposure in exposures]
    assert _gathered(greens, exposures, 1e-4) == pytest.approx([1, 1, 1], abs=1e-5)
    greens[1] = np.zeros_like(scene)
    light = _gathered(greens, exposures, 1e-4)
    assert light[1] == 0
    assert light[0] == pytest.approx(1, abs=1e-5)


def test_a_bracket_that_states_other_exposures_is_told() -> None:
    def bracket(view: str, factor: float) -> Bracket:
        times = (0.25, 1 / 16, 1 / 64)
        return Bracket(
            view, "raw", tuple(Shot(Path(f"{view}_{k}.dng"), shutter=t * factor) for k, t in enumerate(times))
        )

    views = [bracket(f"v{k}", 1.0) for k in range(5)]
    assert judge(views) == []
    found = judge([*views, bracket("odd", 2.0)])
    assert [(finding.kind, finding.views) for finding in found] == [("shifted", ("odd",))]
    assert "1.0 EV longer than those of the other views" in found[0].message
    metered = [bracket(f"m{k}", 2.0**k) for k in range(4)]
    assert judge(metered) == []  # cameras may meter each view


def test_one_image_in_two_views_or_at_two_exposures_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files were copied over others: the table states what they are not."""
    made = captures.write(tmp_path / "raw", size=(48, 32), exposures=3, calibration_frames=1)
    first, second = (made.frames(camera.name) for camera in made.cameras)
    shutil.copy(first[0], second[0])
    assert (
        f"warning: views train_000 and val_001: {first[0].name} and {second[0].name} hold the same image"
    ) in said_of(made.folder, capsys)
    shutil.copy(first[0], first[1])
    assert "error: view train_000: " in (said := said_of(made.folder, capsys))
    assert f"{first[0].name} hold the same image; one is a copy of the other" in said


def test_a_photograph_that_is_listed_twice_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = captures.write(tmp_path / "raw", size=(48, 32), exposures=3, calibration_frames=1)
    table = made.folder / "captures.tsv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join([*lines, lines[1]]) + "\n")
    assert "line 8: a photograph belongs to one view, once; DSC00001.dng is that of line 2" in refused(
        capsys, "check-capture", str(made.folder)
    )


def test_photographs_of_another_kind_are_counted(tmp_path: Path) -> None:
    """JPEGs beside RAW files: of the same shots, and of shots whose RAW files are lost."""
    for name in ("a.JPG", "b.jpg"):
        Path(tmp_path, name).write_bytes(b"")
    Path(tmp_path, "A.dng").write_bytes(b"")
    assert others(tmp_path, photographs(tmp_path)[1]) == (["a.JPG"], ["b.jpg"])
    found = [finding.kind for finding in _left_out(tmp_path, [tmp_path / "A.dng"])]
    assert found == ["paired", "left-out"]


TIMES = (0.25, 0.0625, 0.015625)
HEAD = "view\tfile\tshutter\n"
LISTED = HEAD + "".join(f"v\t{number}.jpg\t{seconds}\n" for number, seconds in enumerate(TIMES))


def phone(values: tuple[float, ...] = (200, 120, 60), size: tuple[int, int] = (32, 24)) -> None:
    """A bracket of JPEGs of these mean values, listed in a table; the second one of another size."""
    from PIL import Image

    Path("c").mkdir()
    pattern = np.random.default_rng(0).uniform(0.6, 1.4, (24, 32, 3))
    for number, value in enumerate(values):
        image = Image.fromarray(np.clip(pattern * value, 0, 255).astype(np.uint8))
        (image if number != 1 else image.resize(size)).save(f"c/{number}.jpg", quality=95)
    Path("c/captures.tsv").write_text(LISTED)


def with_table(text: str) -> None:
    phone()
    Path("c/captures.tsv").write_text(text)


def with_folder(name: str, file: str = "") -> None:
    phone()
    Path("c", name).mkdir(parents=True)
    if file:
        Path("c", name, file).write_text("")


def table_is_a_folder() -> None:
    phone()
    Path("c/captures.tsv").unlink()
    Path("c/captures.tsv").mkdir()


def calibration_is_a_file() -> None:
    phone()
    Path("c/calibration").write_text("x")


PHONE = [
    Fault("one of another size", lambda: phone(size=(40, 24)), "view v: 1.jpg must be 32x24 like 0.jpg"),
    Fault("times that are exchanged", lambda: phone((60, 120, 200)),
          "view v: 1.jpg must be darker than 0.jpg, exposed for longer; their means are "),
    Fault("one image at three times", lambda: phone((90, 90, 90)), "the same image"),
    Fault("frames of no kind", lambda: with_folder("calibration/flats"), "c/calibration/flats is no folder"),
    Fault("a file for calibration frames", calibration_is_a_file, "c/calibration is no folder of calibration frames"),
    Fault("a calibration of nothing", lambda: (phone(), Path("c/calibration.json").write_text("{}"))[0],
          "c/calibration.json is not a calibration"),
    Fault("a table that is a folder", table_is_a_folder, "the table of a capture must be a file; c/captures.tsv"),
    Fault("cells of no column", lambda: with_table(LISTED.replace("0.25", "0.25\tx")), "line 2: there are more cells"),
    Fault("a column twice", lambda: with_table("view\tfile\tfile\na\tb\t0.jpg\n"), "must have the columns view and"),
    Fault("a time of no shutter", lambda: with_table(LISTED.replace("0.25", "1e300")),
          "line 2: shutter must lie between 1e-07 and 100000; found '1e300'"),
    Fault("views that differ by case", lambda: with_table(f"{LISTED}V\t0.jpg\t1\n".replace("v\t0.jpg\t0.25\n", "")),
          "c/captures.tsv, views: v and V differ by case alone"),
    Fault("a quote that is not closed", lambda: with_table(HEAD + '"a\t0.jpg\t1\n'), "cannot be used as a file name"),
    Fault("a line without a file", lambda: with_table(HEAD + "a\t\t1\n"), "must be a file; c is a folder"),
]  # fmt: skip


@named(PHONE)
def test_a_capture_of_a_phone_that_cannot_be(
    fault: Fault, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fault.plant()
    main(["check-capture", "c"])
    said = capsys.readouterr()
    assert fault.said in " ".join((said.out + said.err).split())
    if fault.name != "one image at three times":  # which the development tells
        assert fault.said in refused(capsys, "calibrate", "--capture", "c", "--out", "cal.json")
    assert not Path("cal.json").exists()


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1, 0.4, 0.1), "the longest exposure is black in 100% of the pixels"),
        ((700, 690, 680), "the shortest exposure is clipped in 100% of the pixels"),
    ],
)
def test_a_capture_that_shows_nothing_is_told(
    values: tuple[float, ...],
    said: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    phone(values)
    assert said in said_of(Path("c"), capsys)


def test_photographs_of_16_bits_are_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c").mkdir()
    pattern = np.random.default_rng(0).uniform(10000, 25000, (24, 32, 3))
    for number in range(3):
        cv2.imwrite(f"c/{number}.png", (pattern * 0.5**number).astype(np.uint16))
    Path("c/captures.tsv").write_text(LISTED.replace("jpg", "png"))
    assert "warning: the PNG files of 1 views have 16 bits, of which 8 are used" in said_of(Path("c"), capsys)


@pytest.mark.parametrize(
    ("layer", "value"), [("valid.Y", np.nan), ("valid.Y", 7), ("flags.Y", np.nan), ("flags.Y", -1)]
)
def test_layers_of_a_merged_view_that_cannot_be(
    layer: str, value: float, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr("c/v.exr", {"": np.ones((6, 8, 3), np.float32), layer: np.full((6, 8), value, np.float32)})
    assert main(["calibrate", "--capture", "c", "--out", "cal.json"]) == 0
    files = ("--capture", "c", "--calibration", "cal.json", "--out", "dev", "--manifest", "dev.json")
    assert f"c/v.exr: {layer} must lie between 0 and" in refused(capsys, "develop", *files, "--views", "v")
    assert not Path("dev/hdr").exists()


def test_exposures_that_no_camera_has_are_not_known() -> None:
    stated = [("shutter", 4e9), ("shutter", 1e-9), ("aperture", 1e9), ("iso", 1e12)]
    assert [_usual(key, value) for key, value in stated] == [None] * 4
    assert _usual("shutter", 1 / 8000) == 1 / 8000


def test_hidden_files_are_no_calibration_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fipt.stages.capture.calibration_frames import calibration_frames

    monkeypatch.chdir(tmp_path)
    with_folder("calibration/checkerboard", ".DS_Store")
    assert calibration_frames(Path("c")) == {}
    with pytest.raises(FiptError, match="holds no view 'ghost'"):
        read_capture("c").bracket("ghost")
