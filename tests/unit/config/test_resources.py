"""What jobs ask for, against what was measured."""

import json
import re
from pathlib import Path

import pytest

from fipt.config import load
from fipt.config.resources import FIXED, MEASURED, WORKFLOW, Work, memory_mb, minutes
from fipt.formats.files import write_text
from tests.layouts import write_nerfstudio

REPOSITORY = Path(__file__).resolve().parents[3]
RULES = REPOSITORY / "fipt" / "workflow" / "rules"
NAMES = {
    "hits": "samples",
    "background": "environment",
    "materials": "material_maps",
    "render": "render_views",
    "lamps": "olat_views",
    "olat": "olat_views",
    "metrics": "scene_metrics",
    "report": "scene_report",
    "synthesize": "synthesize_room",
}
"""Stage in docs/scaling.json -> its rule, where that is called otherwise; the first names are of an older version."""
SMALL = ("check-poses", "background", "environment")
"""Stages that did next to nothing there: cameras were not checked, and no light came from outside."""
MEASUREMENTS = json.loads((REPOSITORY / "docs" / "scaling.json").read_text())


def rows():
    for axis in MEASUREMENTS["growth"].values():
        for row in axis:
            every = row["pixels"] * row["views"]
            work = Work(row["pixels"], every, every, row["triangles"], row["pixels"])
            for stage, usage in row["stages"].items():
                yield stage, work, usage["peak"]
    load_test = MEASUREMENTS["load"]
    view = load_test["pixels"] // load_test["views"]
    for stage in ("cache", "fit", "emitters"):
        yield stage, Work(view, load_test["pixels"], load_test["pixels"], 24814, view), load_test[stage]["peak"]


def test_jobs_use_most_of_what_they_ask_for_and_never_all():
    for stage, work, used in rows():
        if stage in SMALL:
            continue
        asked = memory_mb(NAMES.get(stage, stage.replace("-", "_")), work) - WORKFLOW
        assert used <= 0.9 * asked, (stage, work, used, asked)
        assert asked <= 3 * used, (stage, work, used, asked)


def test_another_attempt_asks_for_twice_as_much():
    work = Work(400_000, 6_400_000, 80_000_000, 1_000_000, 400_000)
    one, two = (memory_mb("refine", work, attempt) - WORKFLOW for attempt in (1, 2))
    assert two == pytest.approx(2 * one, abs=1)
    assert minutes("refine", work, 2) == pytest.approx(2 * minutes("refine", work), abs=1)


def test_every_rule_says_what_it_needs():
    for path in RULES.glob("*.smk"):
        for name, text in re.findall(r"^rule (\w+):\n(.*?)(?=^rule |\Z)", path.read_text(), re.MULTILINE | re.DOTALL):
            if "shell:" not in text:
                continue
            assert "mem_mb=" in text, name
            assert "runtime=" in text, name
            if "memory(" in text or "minutes(" in text:
                assert name in MEASURED or name in FIXED, name
                assert set(re.findall(r'(?:memory|minutes)\("(\w+)"\)', text)) == {name}


def test_work_is_counted_in_views_pixels_and_triangles(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = {"train_views": 5, "val_views": 1, "width": 40, "height": 30}
    config = {"scenes": {"a": {"source": "procedural"}}, "synthesize": made, "views_per_shard": 2}
    scene = load(config).scenes["a"]
    write_text(tmp_path / scene.layout.mesh, "x" * 1900)
    assert scene.work("train-002") == Work(1200, 1200, 6000, 100, 1200)
    assert scene.work() == Work(1200, 2400, 6000, 100, 1200)


def test_work_before_an_import_is_that_of_the_mesh_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_nerfstudio(tmp_path / "src")
    config = {"scenes": {"a": {"source": "dataset", "format": "nerfstudio", "path": "src", "mesh": "scan.ply"}}}
    write_text(tmp_path / "scan.ply", "x" * 3800)
    scene = load(config).scenes["a"]
    assert scene.work().triangles == 200
    write_text(tmp_path / scene.layout.mesh, "x" * 1900)
    assert scene.work().triangles == 100


def test_work_after_an_import_is_that_of_the_smaller_images(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = {"train_views": 5, "val_views": 1, "width": 40, "height": 30}
    room = {"source": "procedural", "simulate_raw": True, "settings": {"import": {"downscale": 2}}}
    work = load({"scenes": {"a": room}, "synthesize": made}).scenes["a"].work()
    assert (work.view, work.every, work.photograph, work.photographs) == (300, 1500, 1200, 6000)
    tiny = room | {"settings": {"import": {"downscale": 16}}}
    made |= {"width": 8, "height": 8}  # the import says that nothing is left; a plan does not stop before it
    assert load({"scenes": {"a": tiny}, "synthesize": made}).scenes["a"].work().photographs == 5 * 64
    made |= {"width": 40, "height": 30}
    rendered = load({"scenes": {"a": room | {"simulate_raw": False}}, "synthesize": made}).scenes["a"].work()
    assert rendered.view == rendered.photograph == 1200


@pytest.mark.parametrize(
    ("triangles", "used"), [(20818, 342), (217076, 212), (818102, 454), (763551, 501), (289732, 462), (622814, 641)]
)
def test_imports_ask_for_what_they_used(triangles, used):
    """Measured at 160x120 pixels; small rooms use what libraries take."""
    asked = memory_mb("import_dataset", Work(19200, 0, 0, triangles, 19200)) - WORKFLOW
    assert used <= 0.9 * asked
