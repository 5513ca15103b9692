"""The driver that compares fits with different segments."""

import json

import numpy as np
import pytest

from benchmarks.segment_fit import degrade, main, table
from fipt.formats.images import read_ids, write_png
from tests.fake_results import HEIGHT, VIEWS, WIDTH, write_results


def test_degraded_ids_of_the_training_views(tmp_path):
    root = write_results(tmp_path / "room")
    true = np.where(np.arange(WIDTH) < WIDTH // 2, 300, 7).astype(np.uint16) * np.ones((HEIGHT, 1), np.uint16)
    for view in VIEWS:
        write_png(root / "dataset" / "segments" / "part" / f"{view}.png", true)
    files = degrade(root / "dataset", tmp_path / "out")
    assert [path.name for path in files] == ["a.png", "b.png"]
    for path in files:
        ids = read_ids(path)
        assert ids.shape == true.shape
        assert set(np.unique(ids)) == {1, 2}


def test_the_table_has_figures_side_by_side(tmp_path, capsys):
    for name, roughness in (("one", 0.0312), ("two", None)):
        figures = {"roughness_l1": roughness, "metallic_l1": 0.5, "kd_psnr": 26.0, "render_psnr": 28.0}
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.json").write_text(json.dumps({"val": figures, "train": figures}))
    lines = table([tmp_path / "one", tmp_path / "two"]).splitlines()
    assert lines[0] == "| val | roughness L1 | metallic L1 | kd, dB | re-rendering, dB |"
    assert lines[2:] == ["| one | 0.0312 | 0.5000 | 26.0000 | 28.0000 |", "| two | - | 0.5000 | 26.0000 | 28.0000 |"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["segment_fit", "table", str(tmp_path / "one")])
        assert main() == 0
    assert "| one | 0.0312" in capsys.readouterr().out
