"""``fipt calibrate`` and ``fipt develop``: what they write, and the one line of what they refuse."""

import json
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.formats.exr import read_exr
from fipt.formats.manifests import read_manifest
from tests import captures


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> captures.Capture:
    return captures.write(tmp_path_factory.mktemp("capture") / "raw", size=(120, 90), exposures=3)


def develop(capture: Path, out: Path, views: str, **settings: object) -> int:
    return main(
        [
            *("develop", "--capture", str(capture), "--views", views, "--calibration", str(out / "calibration.json")),
            *("--out", str(out / "capture"), "--manifest", str(out / "capture.manifest.json")),
            *("--stats", str(out / "stats.json"), "--settings", json.dumps(settings)),
        ]
    )


def test_calibrate_then_develop(made: captures.Capture, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibration = tmp_path / "calibration.json"
    assert main(["calibrate", "--capture", str(made.folder), "--out", str(calibration)]) == 0
    out = capsys.readouterr().err
    assert "reprojection error" in out
    assert "vignetting: flat field (4 frames)" in out
    assert json.loads(calibration.read_text())["format"] == 1
    assert develop(made.folder, tmp_path, "train_000,val_001", downscale=2) == 0
    written = sorted(str(path.relative_to(tmp_path)) for path in (tmp_path / "capture").rglob("*") if path.is_file())
    assert written == [
        *("capture/hdr/train_000.exr", "capture/hdr/val_001.exr", "capture/train_000.json", "capture/val_001.json")
    ]
    assert sorted(read_manifest(tmp_path / "capture.manifest.json", "capture")["files"]) == written
    layers = read_exr(tmp_path / "capture/hdr/val_001.exr", required=["R", "G", "B", "valid.Y", "flags.Y"])
    truth = made.truth("val_001")[""]
    found = np.stack([layers[c] for c in "RGB"], axis=-1) * made.camera_truth["radiance_of_full_second"]
    assert found.shape == truth.shape
    assert np.median(np.abs(found / truth - 1)) < 0.01
    assert json.loads((tmp_path / "capture/val_001.json").read_text())["view"] == "val_001"
    assert json.loads((tmp_path / "stats.json").read_text())["views"] == 2
    # The same again, view by view, gives the same bytes.
    before = (tmp_path / "capture/hdr/val_001.exr").read_bytes()
    assert develop(made.folder, tmp_path, "val_001", downscale=2) == 0
    assert (tmp_path / "capture/hdr/val_001.exr").read_bytes() == before


def test_what_is_refused_is_one_line_and_leaves_nothing(
    made: captures.Capture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(code: int) -> str:
        assert code == 2
        return capsys.readouterr().err.strip().splitlines()[-1].replace(str(tmp_path), "").replace(str(made.folder), "")

    assert said(develop(made.folder, tmp_path, "train_000")) == (
        "fipt: error: calibration.json is missing: /calibration.json; check the path, or run the stage that writes it"
    )
    assert main(["calibrate", "--capture", str(made.folder), "--out", str(tmp_path / "calibration.json")]) == 0
    assert said(develop(made.folder, tmp_path, "kitchen")) == (
        "fipt: error:  holds no view 'kitchen'; its views: train_000, val_001"
    )
    assert said(develop(made.folder, tmp_path, "train_000", merge="mean")).startswith(
        "fipt: error: capture.merge: input should be 'mosaic' or 'hat'; found 'mean'"
    )
    assert not (tmp_path / "capture").exists()
    assert not (tmp_path / "capture.manifest.json").exists()


def test_an_incomplete_bracket_stops_only_where_that_is_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    captures.write(tmp_path / "raw", exposures=3, calibration_frames=1, faults=("missing frame",))
    (tmp_path / "raw" / "captures.tsv").unlink()
    for frame in (tmp_path / "raw" / "calibration").rglob("*.dng"):
        frame.unlink()
    assert main(["calibrate", "--capture", str(tmp_path / "raw"), "--out", str(tmp_path / "calibration.json")]) == 0
    assert develop(tmp_path / "raw", tmp_path, "DSC00001", incomplete="error") == 2
    line = "view DSC00001 has 2 exposures where the other views have 3: 1/15 s missing"
    assert (
        capsys.readouterr()
        .err.strip()
        .endswith(f"fipt: error: {line}; complete the bracket, or set capture.incomplete to warn")
    )
    assert develop(tmp_path / "raw", tmp_path, "DSC00001") == 0
    assert line in json.loads((tmp_path / "capture" / "DSC00001.json").read_text())["warnings"]
