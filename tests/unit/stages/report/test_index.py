"""The index of all rooms: what is read of each, in which order, and what the page and the table say."""

import csv
import json
import re

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import write_text
from fipt.lock import locked
from fipt.stages.report.index import index_page, write_index
from fipt.stages.report.rooms import RoomFigure, RoomRow

DEFINITIONS = {"kd_psnr": {"label": "Diffuse kd", "unit": "dB", "better": "higher", "text": "PSNR of kd."}}


def write_room(folder, kd=None, serious=0, failed=False):
    """Write what the index reads of a room."""
    write_text(folder / "logs" / "fit.round-0.log", "3 %\nfipt: error: the <disk> is full; free some space\n")
    if not failed:
        stats = {"wall_s": 90.0, "peak_memory_bytes": 2_000_000_000}
        write_text(folder / "stats" / "fit.round-0.json", json.dumps(stats))
        write_text(folder / "report.html", "")
    if kd is not None:
        write_text(folder / "metrics.json", json.dumps({"val": {"kd_psnr": kd}, "definitions": DEFINITIONS}))
    findings = [{"severity": "serious", "cause": "The lamp\tis dark."}] * serious
    write_text(folder / "findings.json", json.dumps({"findings": findings}))
    write_exr(folder / "dataset" / "images" / "a.exr", {"": np.full((6, 8, 3), 0.3, np.float32)})
    frames = [{"file_path": "images/a.exr", "split": "val"}]
    write_text(folder / "dataset" / "transforms.json", json.dumps({"frames": frames}))


def test_the_worst_room_comes_first(tmp_path):
    write_room(tmp_path / "good", kd=30)
    write_room(tmp_path / "poor", kd=20)
    write_room(tmp_path / "wrong", kd=31, serious=2)
    write_room(tmp_path / "broken", failed=True)
    assert write_index(tmp_path) == 4
    rows = list(csv.DictReader((tmp_path / "summary.tsv").read_text().splitlines(), delimiter="\t"))
    assert [row["room"] for row in rows] == ["broken", "wrong", "poor", "good"]
    assert [row["state"] for row in rows] == ["failed", "done", "done", "done"]
    assert rows[0]["failed"] == "fit.round-0: the <disk> is full; free some space"
    assert (rows[1]["serious"], rows[1]["finding"]) == ("2", "The lamp is dark.")
    assert (rows[2]["kd_psnr"], rows[2]["seconds.fit"], rows[2]["peak_memory_mb"]) == ("20", "90.0", "2000")
    page = (tmp_path / "index.html").read_text()
    assert "the &lt;disk&gt; is full" in page
    assert 'href="good/report.html"' in page
    assert 'href="broken/logs/fit.round-0.log"' in page
    assert page.count("data:image/webp") == 4
    assert not re.search(r'(src|href)="https?:', page)


def test_a_room_that_holds_no_view_out_has_figures_of_training_views(tmp_path):
    """As `fipt metrics` writes them: those of held-out views are there, and null."""
    write_room(tmp_path / "all", kd=25)
    known = json.loads((tmp_path / "all" / "metrics.json").read_text())
    known |= {"val": {"kd_psnr": None, "pixels": {"materials": 0}}, "train": known["val"]}
    write_text(tmp_path / "all" / "metrics.json", json.dumps(known))
    write_room(tmp_path / "some", kd=24)
    write_index(tmp_path)
    table = csv.DictReader((tmp_path / "summary.tsv").read_text().splitlines(), delimiter="\t")
    assert {row["room"]: (row["kd_psnr"], row["views"]) for row in table} == {
        "all": ("25", "training"),
        "some": ("24", "held out"),
    }
    assert (tmp_path / "index.html").read_text().count("figures of training views") == 1


def test_thumbnails_of_rooms_that_have_not_changed_are_kept(tmp_path, monkeypatch):
    write_room(tmp_path / "a", kd=30)
    write_index(tmp_path)
    first = (tmp_path / "index.html").read_text()
    monkeypatch.setattr("fipt.stages.report.rooms.read_rgb", None)  # must not be called
    write_index(tmp_path)
    assert (tmp_path / "index.html").read_text() == first


def test_rooms_without_truth_and_damaged_files_have_a_row(tmp_path):
    write_room(tmp_path / "a")
    write_text(tmp_path / "a" / "findings.json", "{")
    write_index(tmp_path)
    (row,) = csv.DictReader((tmp_path / "summary.tsv").read_text().splitlines(), delimiter="\t")
    assert (row["state"], row["serious"]) == ("done", "")


def test_a_job_at_work_has_not_failed(tmp_path):
    write_room(tmp_path / "busy")
    write_room(tmp_path / "broken")

    def states():
        write_index(tmp_path)
        rows = csv.DictReader((tmp_path / "summary.tsv").read_text().splitlines(), delimiter="\t")
        return {row["room"]: row["state"] for row in rows}

    with locked(tmp_path / "busy"), locked(tmp_path / "broken"):
        write_text(tmp_path / "busy" / "logs" / "metrics.log", "3 %\n")
        write_text(tmp_path / "broken" / "logs" / "metrics.log", "fipt: error: metrics.json is cut; repair it\n")
        assert states() == {"broken": "failed", "busy": "done"}
    assert states() == {"broken": "failed", "busy": "failed"}  # the run ended, and the job has no figures


def test_a_folder_without_rooms_is_told(tmp_path):
    with pytest.raises(FiptError, match="holds no room"):
        write_index(tmp_path)


def test_equal_figures_have_a_distribution():
    rows = [RoomRow(name, "done", figures={"kd_psnr": 30.0}) for name in "ab"]
    page = index_page(rows, [RoomFigure("kd_psnr", **DEFINITIONS["kd_psnr"])])
    assert "<span>30.0</span><span>median 30.0</span><span>30.0</span>" in page
