"""``fipt check-capture``: faults planted in a capture are named, a sound capture is let through."""

import shutil
from datetime import timedelta

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.formats.exr import write_exr
from fipt.synthetic import capture as writer
from tests import captures

SOUND = "sound"


def planted(folder, monkeypatch, *faults):
    """A capture folder without a table, a view for each fault, ten minutes apart."""
    (folder / "all").mkdir(parents=True)
    start = writer.START
    for number, fault in enumerate(faults):
        monkeypatch.setattr(writer, "START", start + number * timedelta(minutes=10))
        part = folder / str(number)
        captures.write(part, views=1, faults=() if fault == SOUND else (fault,), calibration_frames=1, seed=number)
        for path in part.glob("*.dng"):
            shutil.move(path, folder / "all" / f"V{number}_{path.name}")
    return folder / "all"


def test_a_sound_capture_is_let_through(tmp_path, capsys):
    captures.write(tmp_path, views=3)
    before = sorted(tmp_path.rglob("*"))
    assert main(["check-capture", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "nothing is wrong" in printed
    for view in ("train_000", "val_001", "train_002"):
        assert f"{view}" in printed
    assert "5, 8 EV" in printed
    assert sorted(tmp_path.rglob("*")) == before


def test_five_faults_are_all_named(tmp_path, monkeypatch, capsys):
    faults = ("missing frame", "doubled exposure", "mixed iso", "truncated", "clipped shortest", SOUND, SOUND)
    folder = planted(tmp_path, monkeypatch, *faults)
    assert main(["check-capture", str(folder)]) == 2
    lines = capsys.readouterr().out.splitlines()
    for view, said in (
        ("V0_DSC00001", "warning: view V0_DSC00001 has 4 exposures where the other views have 5: 1/250 s missing"),
        ("V1_DSC00001", "error: view V1_DSC00001: V1_DSC00002.dng and V1_DSC00003.dng have the same exposure"),
        ("V2_DSC00001", "warning: mixed ISO: most photographs have ISO 100, but V2_DSC00003.dng ISO 400"),
        ("V3_DSC00001", "V3_DSC00002.dng is truncated or damaged"),
        ("V4_DSC00001", "the shortest exposure is clipped in up to"),
    ):
        assert any(said in line for line in lines), (said, lines)
        named = [line for line in lines if line.startswith(("error", "warning")) and view in line]
        assert any(said in line for line in named), (view, named)
    for view in ("V5_DSC00001", "V6_DSC00001"):
        assert not any(view in line for line in lines if line.startswith(("error", "warning")))


@pytest.mark.parametrize(
    ("fault", "code", "said"),
    [
        ("wrong size", 2, "V0_DSC00003.dng is 112x96, the others 128x96"),
        ("other orientation", 2, "the frames of a bracket must have one orientation; V0_DSC00003.dng differs"),
        ("other camera", 2, "V0_DSC00003.dng and 0 others are of fipt Other camera"),
        ("no exposure time", 2, "V0_DSC00003.dng states no exposure time"),
        ("not raw", 2, "V0_DSC00002.dng is not a RAW file that LibRaw reads"),
        ("mixed aperture", 0, "mixed aperture: most photographs have f/8, but V0_DSC00003.dng f/5.6"),
    ],
)
def test_other_faults(tmp_path, monkeypatch, capsys, fault, code, said):
    folder = planted(tmp_path, monkeypatch, fault, SOUND, SOUND)
    assert main(["check-capture", str(folder)]) == code
    assert said in capsys.readouterr().out


def test_missing_calibration_is_noted(tmp_path, capsys):
    captures.write(tmp_path, views=1)
    shutil.rmtree(tmp_path / "calibration" / "flat")
    assert main(["check-capture", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "note: no calibration frames of: flat; photograph them" in printed
    assert "note: lensfun does not know the lens Simulated lens on fipt Simulated camera" in printed
    shutil.rmtree(tmp_path / "calibration")
    assert main(["check-capture", str(tmp_path), "--quick"]) == 0
    assert "no calibration frames of: board, flat, dark, white" in capsys.readouterr().out


def test_quick_reads_no_pixels(tmp_path, monkeypatch, capsys):
    folder = planted(tmp_path, monkeypatch, "truncated", "mixed aperture", SOUND)
    assert main(["check-capture", str(folder), "--quick"]) == 0
    printed = capsys.readouterr().out
    assert "mixed aperture" in printed
    assert "truncated" not in printed


def test_a_folder_without_photographs(tmp_path, capsys):
    assert main(["check-capture", str(tmp_path)]) == 2
    assert "must hold photographs" in capsys.readouterr().err
    assert main(["check-capture", str(tmp_path / "nowhere")]) == 2
    assert "the capture folder is missing" in capsys.readouterr().err


def test_merged_views_are_read_and_said_to_be_unmeasured(tmp_path, capsys):
    radiance = np.ones((6, 8, 3), np.float32)
    write_exr(tmp_path / "good.exr", {"": radiance})
    radiance[2, 3, 0], radiance[4, 4, 1] = np.nan, np.inf
    write_exr(tmp_path / "bad.exr", {"": radiance})
    assert main(["check-capture", str(tmp_path)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "warning: view bad: 2 pixels are NaN or infinite; they get weight 0" in printed
    assert "view good" not in printed
    assert "are not measured" in printed
    assert "nothing is wrong" not in printed
    (tmp_path / "bad.exr").write_bytes(b"no image")
    assert main(["check-capture", str(tmp_path)]) == 2
    assert "error: view bad: " in capsys.readouterr().out
