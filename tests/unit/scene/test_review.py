"""emitters_review.yaml: what a person may decide, how it reaches the stages, and that it survives every run."""

import json
from pathlib import Path

import pytest
import yaml

from fipt.errors import FiptError
from fipt.scene.review import Review, matched, numbers, parse_decisions, ranges, read_review, refreshed, write_review

FACTS = {"area": 0.5, "power": 12.0, "share": 0.25, "confidence": 0.9, "views": 4}


def lamps(*triangles):
    """Lamps as a run finds them, numbered in this order."""
    return [
        {
            "emitter": f"emitter-{n}",
            "question": None,
            "triangles": frozenset(own),
            "thumbnail": f"emitters/emitter-{n}.png",
            **FACTS,
        }
        for n, own in enumerate(triangles)
    ]


@pytest.fixture
def path(tmp_path):
    """The file of three lamps, as the first run writes it."""
    path = tmp_path / "emitters_review.yaml"
    write_review(path, refreshed(None, lamps({5, 6, 7}, {20}, {30, 31, 40}), 100))
    return path


def decide(path, **decisions):
    """Change entries, by number: decide(path, emitter_1={"verdict": "reject"})."""
    content = yaml.safe_load(path.read_text())
    for key, values in decisions.items():
        content["emitters"][int(key.removeprefix("emitter_"))] |= values
    path.write_text(yaml.safe_dump(content))
    return read_review(path)


# --- triangles as text ----------------------------------------------------------------------------


def test_a_link_to_decisions_kept_elsewhere_stays_one(tmp_path: Path) -> None:
    kept, path = tmp_path / "kept.yaml", tmp_path / "emitters_review.yaml"
    path.symlink_to(kept)
    write_review(path, refreshed(None, lamps({5, 6, 7}), 100))
    assert path.is_symlink()
    assert read_review(kept) is not None


def test_ranges_and_back(np_rng):
    assert ranges([20, 5, 6, 7, 8]) == "5-8, 20"
    assert numbers("5-8,20", 21) == {5, 6, 7, 8, 20}
    for size in (0, 1, 30):
        drawn = frozenset(np_rng.choice(60, size, replace=False).tolist())
        assert not drawn or numbers(ranges(drawn), 60) == drawn


@pytest.mark.parametrize(
    ("text", "said"), [("", "like 5-16"), ("7-5", "like 5-16"), ("a", "like"), ("0-9", "no triangle 9")]
)
def test_wrong_ranges_are_refused(text, said):
    with pytest.raises(FiptError, match=said):
        numbers(text, 9)


def test_lamps_are_matched_by_the_triangles_they_share():
    there = [{1, 2, 3}, {4, 5, 6, 7}, {8}]
    assert matched([frozenset({3, 4, 5}), frozenset({6, 1, 2}), frozenset({99})], there) == {0: 1, 1: 0}
    assert matched([frozenset({4}), frozenset({5, 6})], there) == {1: 1}  # each is taken once


# --- decisions ------------------------------------------------------------------------------------


def test_an_untouched_file_decides_what_no_file_decides(path):
    review = read_review(path)
    assert [entry.emitter for entry in review.entries] == ["emitter-0", "emitter-1", "emitter-2"]
    assert (review.emission(), review.listing()) == (Review(100).emission(), Review(100).listing()) == ("", "")


def test_decisions_are_keyed_by_triangles(path):
    review = decide(
        path,
        emitter_0={"verdict": "accept", "merge_with": "emitter-2"},
        emitter_1={"verdict": "reject"},
        emitter_2={"name": "window"},
    )
    assert json.loads(review.emission()) == {
        "mesh_triangles": 100,
        "accept": ["5-7"],
        "reject": ["20"],
        "merge": [["30-31, 40", "5-7"]],
    }
    assert json.loads(review.listing()) == {
        "mesh_triangles": 100,
        "names": {"window": "5-7, 30-31, 40"},
        "reject": ["20"],
    }


def test_names_change_the_listing_alone(path):
    before = read_review(path).emission()
    named = decide(path, emitter_1={"name": "desk lamp"})
    assert named.emission() == before
    assert named.names() == {"desk lamp": {20}}


def test_the_order_and_the_facts_decide_nothing(path):
    review = decide(path, emitter_0={"verdict": "reject"}, emitter_2={"verdict": "reject"})
    content = yaml.safe_load(path.read_text())
    content["emitters"] = [entry | {"area": 9.0, "thumbnail": None} for entry in reversed(content["emitters"])]
    path.write_text(yaml.safe_dump(content))
    assert read_review(path).emission() == review.emission()


def test_decisions_of_another_mesh_are_refused(path):
    text = decide(path, emitter_0={"verdict": "reject"}).emission()
    assert parse_decisions(text, 100).reject == ("5-7",)
    assert parse_decisions("", 3).reject == ()
    with pytest.raises(FiptError, match=r"of a mesh of 100; the mesh has 90; delete that file"):
        parse_decisions(text, 90)
    with pytest.raises(FiptError, match=r"unknown key decisions\.rejct"):
        parse_decisions('{"mesh_triangles": 9, "rejct": []}', 9)


# --- a run writes the file again ------------------------------------------------------------------


def test_a_run_keeps_what_was_decided(path):
    """The rejected lamp is found no more, the named one has other triangles and another number, a new one is there."""
    before = decide(path, emitter_0={"verdict": "reject"}, emitter_2={"name": "window"})
    after = refreshed(before, lamps({20, 21}, {30, 31, 41}, {50}), 100, {frozenset({5, 6, 7}): "emitters/r.png"})
    write_review(path, after)
    again = read_review(path)
    assert (again.emission(), again.listing()) == (before.emission(), before.listing())
    rows = [(e.emitter, e.name, e.verdict, e.triangles, e.thumbnail) for e in again.entries]
    assert rows == [
        ("emitter-0", None, "auto", "20-21", "emitters/emitter-0.png"),
        ("emitter-1", "window", "auto", "30-31, 40", "emitters/emitter-1.png"),
        ("emitter-2", None, "auto", "50", "emitters/emitter-2.png"),
        (None, None, "reject", "5-7", "emitters/r.png"),
    ]
    text = path.read_text()
    write_review(
        path, refreshed(again, lamps({20, 21}, {30, 31, 41}, {50}), 100, {frozenset({5, 6, 7}): "emitters/r.png"})
    )
    assert path.read_text() == text


def question(*triangles, number=0):
    """Surface that may emit, as a run finds it."""
    image = f"emitters/undecided-{number}.png"
    return {"emitter": None, "question": "emitter or mirror?", "thumbnail": image, "triangles": frozenset(triangles)}


def test_what_is_undecided_is_an_entry_that_a_person_decides(path):
    write_review(path, refreshed(read_review(path), [*lamps({5, 6, 7}), question(50, 51)], 100))
    asked = read_review(path).entries[1]
    assert (asked.question, asked.verdict, asked.triangles) == ("emitter or mirror?", "auto", "50-51")
    assert read_review(path).emission() == ""
    accepted = decide(path, emitter_1={"verdict": "accept"})
    assert json.loads(accepted.emission()) == {"accept": ["50-51"], "mesh_triangles": 100}
    after = refreshed(accepted, lamps({5, 6, 7}, {50, 51}), 100)
    rows = [(e.emitter, e.question, e.verdict, e.triangles) for e in after.entries]
    assert rows == [("emitter-0", None, "auto", "5-7"), ("emitter-1", None, "accept", "50-51")]


def test_a_rejected_question_stays_rejected_and_is_asked_no_more(path):
    write_review(path, refreshed(read_review(path), [*lamps({5, 6, 7}), question(50, 51)], 100))
    rejected = decide(path, emitter_1={"verdict": "reject"})
    write_review(path, refreshed(rejected, lamps({5, 6, 7}), 100, {frozenset({50, 51}): "emitters/rejected-50.png"}))
    again = read_review(path)
    assert again.emission() == rejected.emission()
    last = again.entries[-1]
    assert (last.question, last.verdict, last.thumbnail) == (None, "reject", "emitters/rejected-50.png")


def test_a_merged_lamp_keeps_both_entries(path):
    before = decide(path, emitter_0={"merge_with": "emitter-1"})
    write_review(path, refreshed(before, lamps({30, 31, 40}, {5, 6, 7, 20}), 100))
    again = read_review(path)
    assert again.emission() == before.emission()
    rows = {entry.triangles: (entry.emitter, entry.merge_with) for entry in again.entries}
    assert rows == {"30-31, 40": ("emitter-0", None), "20": ("emitter-1", None), "5-7": (None, "emitter-1")}
    # a round that finds neither keeps them too
    write_review(path, refreshed(again, lamps({30, 31, 40}), 100))
    assert read_review(path).emission() == before.emission()


def test_a_decision_can_be_taken_back(path):
    rejected = decide(path, emitter_1={"verdict": "reject"})
    write_review(path, refreshed(rejected, lamps({5, 6, 7}, {30, 31, 40}), 100))
    taken_back = decide(path, emitter_2={"verdict": "auto"})
    assert taken_back.emission() == ""
    assert len(refreshed(taken_back, lamps({5, 6, 7}, {20}, {30, 31, 40}), 100).entries) == 3


def test_the_file_is_for_people(path):
    text = path.read_text()
    assert text.startswith("# The emitters that were found.")
    assert "  triangles: 30-31, 40\n" in text
    stamp = path.stat().st_mtime_ns
    write_review(path, read_review(path))
    assert path.stat().st_mtime_ns == stamp


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("decisions", "said"),
    [
        ({"emitter_0": {"verdct": "reject"}}, "unknown key emitter-0.verdct; a person sets verdict"),
        (
            {"emitter_0": {"verdict": "no"}},
            "emitter-0.verdict: input should be 'auto', 'accept' or 'reject'; found 'no'",
        ),
        ({"emitter_0": {"name": 7}}, "name: input should be a valid string; found 7"),
        ({"emitter_0": {"name": "emitter-1"}}, "names like emitter-3, rest, outside and surface"),
        ({"emitter_0": {"name": "a\nb"}}, "1 to 60 printable"),
        ({"emitter_0": {"name": "Desk"}, "emitter_1": {"name": "desk"}}, "two emitters are named 'desk'"),
        (
            {"emitter_0": {"merge_with": "emitter-9"}},
            "emitter-0 is to merge with 'emitter-9', which is no emitter; there are emitter-1",
        ),
        ({"emitter_0": {"merge_with": "emitter-0"}}, "emitter-0 is to merge with itself"),
        ({"emitter_0": {"merge_with": "emitter-1"}, "emitter_1": {"verdict": "reject"}}, "but emitter-1 is rejected"),
        ({"emitter_0": {"triangles": "5-7, 20"}}, "emitter-1 and emitter-0 both have triangle 20"),
        ({"emitter_0": {"triangles": "100"}}, "there is no triangle 100; triangles go from 0 to 99"),
        ({"emitter_0": {"triangles": "some"}}, "triangles must be like 5-16, 20; found 'some'"),
    ],
)
def test_a_wrong_file_is_explained(path, decisions, said):
    with pytest.raises(FiptError) as caught:
        decide(path, **decisions)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("emitters: [", "is not YAML"),
        ("- 3", "must hold keys at its top level"),
        ("mesh_triangles: 3\nemitters: []\nlamp: 3", "unknown key lamp; its keys are mesh_triangles, emitters"),
        ("mesh_triangles: 3\nlamps: []", "the key lamps is called emitters now; write emitters: for lamps:"),
        ("emitters: []", "mesh_triangles must be a number of triangles"),
        ("mesh_triangles: 3\nemitters: 4", "emitters must be a list; found 4"),
        ("mesh_triangles: 3\nemitters: [4]", "entry 1 must hold keys; found 4"),
    ],
)
def test_a_broken_file_is_explained(path, text, said):
    path.write_text(text)
    with pytest.raises(FiptError) as caught:
        read_review(path)
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_no_file_is_no_review(tmp_path):
    assert read_review(tmp_path / "none.yaml") is None
