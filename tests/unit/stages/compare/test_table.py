"""Scores of methods and the table of a comparison: nothing that is unknown is a number, nothing is ranked in noise."""

import csv
import io
import json

import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.stages.compare.rooms import across_rooms
from fipt.stages.compare.score import parse_card, scored
from fipt.stages.compare.table import COLUMNS, comparison
from fipt.stages.compare.written import as_csv, as_markdown, rooms_as_csv
from fipt.stages.report.compared_rooms import build_rooms

CARD = {
    "id": "fipt",
    "seed": 0,
    "label": "This program",
    "kind": "method",
    "estimator": "fit",
    "random": True,
    "source": "here",
    "deviations": "none",
    "inputs": ["images"],
    "oracle": [],
    "not_estimated": [],
    "settings": {},
    "rounds": 1,
}


def metrics(kd, metallic=0.0, render=30.0):
    val = {"kd_psnr": kd, "metallic_l1": metallic, "emission_iou": 1.0, "render_psnr": render}
    published = {"kd_psnr": kd + 1, "roughness_psnr": 20.0}
    return {
        "val": val,
        "train": val | {"published": published},
        "emitters": {"false_triangles": 2},
        "relight": {"night": {"relight_psnr": render + 5}},
        "definitions": {"kd_psnr": {"text": "what kd means"}},
    }


def method(kd, job=(2.0, 10), **changed):
    jobs = [{"wall_s": job[0], "peak_memory_bytes": job[1]}, {"wall_s": 1.0, "peak_memory_bytes": 7}]
    return scored(CARD | changed, metrics(kd), jobs)


def test_what_is_not_estimated_is_null():
    found = method(20.0, not_estimated=["roughness", "metallic"])
    assert found["figures"]["val"]["metallic_l1"] is None
    assert found["figures"]["train"]["published"] == {"kd_psnr": 21.0, "roughness_psnr": None}
    assert found["figures"]["val"]["kd_psnr"] == 20.0
    assert (found["time_s"], found["peak_memory_bytes"]) == (3.0, 10)
    assert method(20.0, not_estimated=["emission"])["figures"]["emitters"]["false_triangles"] is None


def firsts(runs):
    return {row["id"] for row in comparison(runs, {})["methods"] if row["figures"]["kd_psnr"]["first"]}


def test_differences_below_the_spread_are_not_ranked():
    runs = [method(20.0), method(20.6, seed=1), method(20.8, id="a"), method(21.0, id="a", seed=1)]
    assert firsts(runs) == {"fipt", "a"}
    runs = [method(20.0), method(20.1, seed=1), method(20.8, id="a"), method(21.0, id="a", seed=1)]
    assert firsts(runs) == {"a"}
    # one seed: the spread of others stands for its own, but what has no random numbers has none
    runs = [method(20.0), method(20.4, seed=1), method(20.5, id="b")]
    assert firsts(runs) == {"fipt", "b"}
    assert firsts([method(20.0), method(20.5, id="b")]) == {"b"}
    assert firsts([method(20.0), method(20.2, id="b")]) == {"fipt", "b"}
    assert firsts([method(20.0, random=False), method(20.2, id="b", random=False)]) == {"b"}


def test_who_knows_the_truth_is_not_ranked():
    runs = [method(20.0), method(30.0, id="bound", kind="bound"), method(40.0, id="told", oracle=["true mask"])]
    assert firsts(runs) == {"fipt"}


def test_the_table_for_people_and_for_spreadsheets():
    runs = [method(20.0), method(20.6, seed=1), method(22.0, id="a", label="A", not_estimated=["metallic"])]
    table = comparison(runs, {"b": "needs segment ids, and the scene has none"}, {"a.seed-1": "fit: no room"})
    assert table["columns"][0]["text"] == "what kd means"
    text = as_markdown(table)
    assert "| This program | 20.3 (0.6) | – |" in text  # noqa: RUF001
    assert "| A | **22.0** |" in text
    assert "| `b` | not applicable: needs segment ids" in text
    assert "| `a.seed-1` | failed: fit: no room |" in text
    assert (
        len({line.replace("\\|", "").count("|") for line in text.split("##")[0].splitlines() if line.startswith("|")})
        == 1
    )
    rows = list(csv.DictReader(io.StringIO(as_csv(table))))
    assert [row["method"] for row in rows] == ["fipt", "a", "b", "a.seed-1"]
    assert rows[3]["absent"] == "failed: fit: no room"
    assert (rows[0]["kd_psnr"], rows[0]["kd_psnr_spread"], rows[1]["kd_psnr_spread"]) == ("20.3", "0.6", "")
    assert rows[1]["metallic_l1"] == ""
    assert rows[0]["relit_night"] == "35"


def test_the_verbs_write_their_files(tmp_path):
    (tmp_path / "metrics.json").write_text(json.dumps(metrics(20.0)))
    (tmp_path / "fit.json").write_text(json.dumps({"wall_s": 3.0, "peak_memory_bytes": 5}))
    out = tmp_path / "method.json"
    options = ["--metrics", str(tmp_path / "metrics.json"), "--jobs", str(tmp_path / "fit.json"), "--out", str(out)]
    assert main(["score", "--card", json.dumps(CARD), *options]) == 0
    table = tmp_path / "compare" / "table.json"
    assert (
        main(
            [
                "compare",
                "--methods",
                str(out),
                "--not-applicable",
                "b=no, truth",
                "--failed",
                "c=x=y",
                "--out",
                str(table),
            ]
        )
        == 0
    )
    found = json.loads(table.read_text())
    assert found["not_applicable"] == {"b": "no, truth"}
    assert found["failed"] == {"c": "x=y"}
    assert found["methods"][0]["figures"]["kd_psnr"]["mean"] == 20.0
    assert table.with_suffix(".md").is_file()
    assert table.with_suffix(".csv").is_file()
    assert main(["score", "--card", "{}", *options]) == 2


def test_the_mean_over_rooms_is_of_what_every_room_has():
    own, other = [method(20.0), method(20.6, seed=1)], [method(26.0), method(26.6, seed=1)]
    rooms = {
        "a": comparison([*own, method(23.0, id="b"), method(50.0, id="c")], {}),
        "b": comparison([*other, method(23.0, id="b")], {"c": "needs truth"}),
    }
    found = across_rooms(rooms)
    rows = {row["id"]: row for row in found["mean"]["methods"]}
    assert rows["fipt"]["figures"]["kd_psnr"]["values"] == pytest.approx([23.0, 23.6])
    assert rows["fipt"]["figures"]["kd_psnr"]["text"] == "23.3 (0.6)"
    assert rows["b"]["figures"]["kd_psnr"]["first"]  # 0.3 dB behind, below the spread of the other
    assert rows["fipt"]["figures"]["relit"]["mean"] == 35.0
    assert rows["b"]["figures"]["metallic_l1"]["mean"] == 0.0
    assert found["mean"]["not_applicable"] == {"c": "in b: not applicable: needs truth"}
    cells = list(csv.DictReader(io.StringIO(rooms_as_csv(found))))
    assert [(row["room"], row["method"]) for row in cells[:4]] == [
        ("mean", "fipt"),
        ("mean", "b"),
        ("mean", "c"),
        ("a", "fipt"),
    ]
    assert cells[0]["relit_night"] == ""
    page = build_rooms(found)
    assert "../b/compare.html" in page
    with pytest.raises(FiptError, match="found one scene"):
        build_rooms(rooms["a"])


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_a_row_of_the_mean_says_what_holds_in_any_room(order):
    other = {"id": "other", "kind": "imported", "random": False}
    scaled = other | {"label": "Other, 1 view only", "views": ["k"], "oracle": ["scale"], "not_estimated": ["metallic"]}
    found = {"id": "moved", "kind": "sensitivity"}
    rooms = {
        "a": comparison([method(20.0), method(25.0, label="Other", **other), method(9.0, findings=[], **found)], {}),
        "b": comparison([method(20.0), method(30.0, **scaled), method(9.0, findings=[{"id": "x"}], **found)], {}),
    }
    rows = {row["id"]: row for row in across_rooms({name: rooms[name] for name in order})["mean"]["methods"]}
    row = rows["other"]
    assert (row["oracle"], row["views"], row["not_estimated"]) == (["scale"], ["k"], ["metallic"])
    assert set(row["label"].split(" / ")) == {"Other", "Other, 1 view only"}
    assert not row["figures"]["kd_psnr"]["first"]
    assert rows["fipt"]["figures"]["kd_psnr"]["first"]
    assert (rows["moved"]["findings"], rows["fipt"]["findings"]) == ([{"id": "x"}], None)
    assert rows["fipt"]["label"] == "This program"


def test_every_column_reads_what_is_scored():
    found = method(20.0)["figures"]
    assert {column.place[1] for column in COLUMNS} <= set(found)
    with pytest.raises(FiptError, match="must be the card of a method"):
        parse_card("[]")
