"""The page's section on the exported room."""

import json

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import write_text
from fipt.stages.report.page import build_page
from fipt.stages.report.settings import ReportSettings
from tests import fake_results


def test_shows_figures_and_pictures_of_every_file(tmp_path):
    root = fake_results.write_results(tmp_path / "room")
    without = build_page(root, ReportSettings())
    assert 'id="export"' not in without
    assert 'href="#export"' not in without
    formats = {
        "glb": {"file": "scene.glb", "psnr": 33.25, "photo": 29.0, "views": {"c": 33.25}},
        "<new>": {"file": "<b>.x", "psnr": 20.0, "photo": 19.0, "views": {"c": 20.0}},
    }
    write_text(root / "export/check.json", json.dumps({"goal": 32, "ours_photo": 30.5, "formats": formats}))
    shape = fake_results.HEIGHT, fake_results.WIDTH, 3
    write_exr(root / "export/check/glb/c.exr", {"": np.full(shape, 0.3, np.float32)})
    page = build_page(root, ReportSettings())
    assert page.count("<img") == without.count("<img") + 2  # ours and the one that is there
    for text in (
        'href="#export"',
        "scene.glb",
        "33.2 dB",
        "glTF, 33.2 dB",
        "32.0 dB is aimed at",
        "30.5 dB",
        "&lt;b&gt;.x",
    ):
        assert text in page, text
    assert "<b>.x" not in page


def test_a_damaged_check_is_refused(tmp_path):
    root = fake_results.write_results(tmp_path / "room")
    write_text(root / "export/check.json", json.dumps({"goal": 32, "ours_photo": 1, "formats": {"glb": {}}}))
    with pytest.raises(FiptError, match="is not the check of an export"):
        build_page(root, ReportSettings())
