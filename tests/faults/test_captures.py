"""Captures are not trusted: covered exposures, exposures that lie, and calibration frames of something else."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.stages.capture.brackets import Bracket, _left_out, judge
from fipt.stages.capture.folder import others, photographs
from fipt.stages.capture.quality import _gathered
from fipt.stages.capture.raw import Shot
from tests import captures
from tests.faults.faults import refused


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
