"""What the page says about a mesh that was made of the photographs."""

import json

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.images import write_png
from fipt.stages.report.geometry import read_geometry
from fipt.stages.report.page import build_page
from fipt.stages.report.settings import ReportSettings

ABOUT = {
    "known": 0.33,
    "completed": 0.43,
    "closed": 0.24,
    "noise_mm_at_1m": 0.34,
    "voxel_mm": 14.0,
    "planes": 2,
    "surface": {"measured": 0.5, "completed": 0.25, "closed": 0.15, "unseen": 0.1},
    "of_view": {"a": {"known": 0.5, "closed": 0.1}, "b": {"known": 0.1, "closed": 0.6}},
}


def test_views_that_show_little_are_named(tmp_path):
    assert read_geometry(tmp_path) is None
    folder = tmp_path / "geometry"
    folder.mkdir()
    (folder / "geometry.json").write_text(json.dumps(ABOUT))
    write_png(folder / "overview.png", np.zeros((20, 60, 3), np.uint8))
    found = read_geometry(folder)
    assert found is not None
    assert found.bare == ["b"]
    assert found.image is not None
    page = build_page(tmp_path, ReportSettings())
    assert "24 % show a wall" in page
    assert "2 planes were found" in page


def test_a_scan_that_was_placed_is_told(tmp_path):
    placed = {"turned": 12.0, "moved": 0.5, "share": 0.93, "residual_mm": 4.0}
    (tmp_path / "geometry.json").write_text(json.dumps({"known": 0.5, "registration": placed}))
    found = read_geometry(tmp_path)
    assert found is not None
    assert "93 % lie on it, at a median distance of 4.0 mm" in found.words


def test_another_file_is_refused(tmp_path):
    (tmp_path / "geometry.json").write_text("{}")
    with pytest.raises(FiptError, match="is not what fipt mesh writes"):
        read_geometry(tmp_path)
