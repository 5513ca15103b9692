"""The segments' section: what it shows of a fusion, and when it is left out."""

import json

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.images import write_png
from fipt.scene.dataset import Dataset
from fipt.scene.segment_colors import in_colors
from fipt.scene.segments import write_view_ids
from fipt.stages.report.page import build_page
from fipt.stages.report.segments import read_segments
from fipt.stages.report.settings import ReportSettings
from tests.fake_results import HEIGHT, WIDTH, write_results

HALVES = np.repeat([[1] * (WIDTH // 2) + [2] * (WIDTH // 2)], HEIGHT, axis=0).astype(np.uint16)


@pytest.fixture
def results(tmp_path):
    """Two training views, each with two segments whose numbers are exchanged in view b."""
    root = write_results(tmp_path / "scene")
    for view in "ab":
        ids = HALVES if view == "a" else 3 - HALVES
        write_view_ids(root / "segments" / "views" / f"{view}.npz", ids, np.array([0, 1, 1]))
        write_png(root / "segments" / "fused" / "part" / f"{view}.png", HALVES)
        write_png(root / "segments" / "fused" / "agreement" / f"{view}.png", np.full((HEIGHT, WIDTH), 255, np.uint8))
    listed = [
        {"id": 2, "name": "<b>chair</b> 2", "area": 0.5, "views": 2, "agreement": 0.75},
        {"id": 1, "name": "wall 1", "area": 12.0, "views": 2, "agreement": 1.0},
    ]
    fusion = {"source": "views", "agreement": 0.9, "kinds": ["semantic", "part"], "segments": listed}
    write_text(root / "segments" / "fusion.json", json.dumps(fusion))
    stats(root, "fit.round-0", {"segments": "part", "fused_segments": True})
    settings = {"mode": "mask2former", "task": "panoptic", "model": "someone/rooms"}
    stats(root, "segment.train-000", {"settings": settings})
    return root


def stats(root, label, figures):
    write_text(root / "stats" / f"{label}.json", json.dumps(figures))


def shown(root, mode=None):
    """What the section has, with its pictures as arrays by heading."""
    return read_segments(root / "segments", Dataset(root / "dataset"), mode or {}, 1.0, lambda *pair: pair)


def test_a_segment_has_one_colour_before_and_after(results):
    found = shown(results)
    assert list(found.views) == ["a", "b"]
    for pictures in found.views.values():
        by_heading = dict(pictures)
        assert list(by_heading) == ["On the photograph", "Before fusion", "Fused", "Agreement of votes"]
        np.testing.assert_array_equal(by_heading["Before fusion"], by_heading["Fused"])
        np.testing.assert_array_equal(by_heading["Fused"], in_colors(HALVES))
        assert by_heading["Agreement of votes"].min(axis=(0, 1)).max() > 200
    assert [entry["id"] for entry in found.segments] == [1, 2]


def test_grown_parts_have_no_votes(results):
    path = results / "segments" / "fusion.json"
    write_text(path, json.dumps(json.loads(path.read_text()) | {"source": "geometry"}))
    found = shown(results)
    assert found.agreement is None
    assert [heading for heading, _ in found.views["a"]] == ["On the photograph", "Fused"]
    assert "grown on the mesh" in found.source


def test_the_page(results):
    page = build_page(results, ReportSettings())
    assert "Mask2Former (panoptic, someone/rooms) segments each view by itself: 2 segments" in page
    assert "90 % of the views" in page
    assert "&lt;b&gt;chair&lt;/b&gt; 2" in page
    assert page.count("Before fusion, view") == 4  # two views: name of the button, and of the picture

    # The fit took other ids, or none: a fusion of before is not shown.
    stats(results, "fit.round-0", {"segments": "none", "fused_segments": False})
    page = build_page(results, ReportSettings())
    assert 'id="segments"' not in page
    assert "The fit ran without segments: roughness and metallic are unsure wherever no view sees" in page


def test_a_damaged_list_is_named(results):
    write_text(results / "segments" / "fusion.json", "{}")
    with pytest.raises(FiptError, match=r"fusion.json is not a list of fused segments .*run fipt fuse again"):
        shown(results)
