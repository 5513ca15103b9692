"""The benchmark of development: that it runs, on small pictures, and measures what it says."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import capture
from fipt.scene.cameras import Camera


def test_errors_of_both_merges_with_both_lenses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = capture.error_table(240, 160, tmp_path)
    assert [(row["merge"], row["lens"]) for row in rows] == [
        *(("mosaic", "calibrated"), ("hat", "calibrated"), ("mosaic", "true"), ("hat", "true"))
    ]
    for row in rows:
        assert 0 < row["p50"] < row["p90"] < row["p99"]
        assert row["p50"] < 3
    assert abs(rows[2]["flats"]) < 0.3
    assert "k1" in capsys.readouterr().out
    assert capture.printed(rows).count("\n") == 5


def test_the_picture_has_shadows_lamps_and_colours() -> None:
    picture = capture.picture(Camera("a", "train", 240, 160, 171.0, 171.0, 120.0, 80.0, np.eye(4)))
    assert picture.max() > 30
    assert 0 < picture.min() < 0.02
    assert np.abs(picture[..., 0] / picture[..., 2] - 1).max() > 1


def test_speed_of_a_large_bracket_is_measured_in_a_process_of_its_own(tmp_path: Path) -> None:
    figures = capture.speed(tmp_path, 480, 320)
    assert (tmp_path / "out" / "hdr" / "DSC00000.exr").is_file()
    assert 0 < figures["cpu"] < 30
    assert figures["peak"] > 1e7
