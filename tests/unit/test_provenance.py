"""provenance.json: what was changed, what decayed, what tells two runs apart."""

import json
import os
import shutil
from pathlib import Path

import pytest

from fipt.cli.main import main
from fipt.formats.manifests import write_manifest
from fipt.provenance import NAME, changes, compared, read_provenance, record
from tests import fake_results


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder of results with a file of every kind that stages write, and an input beside it."""
    root = tmp_path_factory.mktemp("made")
    results = fake_results.write_results(root / "room")
    fake_results.write_camera_setup(results)
    (root / "photograph.dng").write_bytes(b"raw " * 30)
    kinds = {
        "export/scene.glb": b"glTF",
        "round-0/model.safetensors": b"{}",
        "environment.npz": b"PK",
        "findings/a.jpg": b"j",
    }
    for name, content in {**kinds, "report.html": b"<html>", "emitters_review.yaml": b"a: 1"}.items():
        (results / name).parent.mkdir(parents=True, exist_ok=True)
        (results / name).write_bytes(content * 20)
    write_manifest(results / "export.manifest.json", "export", [results / "export/scene.glb"], {})
    (results / "stats").mkdir(exist_ok=True)
    stats = {"stage": "fit", "version": 1, "settings": {"steps": 5}, "wall_s": 2.0}
    (results / "stats" / "fit.round-0.json").write_text(json.dumps(stats))
    record(results, {"rounds": 1}, [str(root / "photograph.dng")])
    return root


@pytest.fixture
def room(made, tmp_path):
    """A copy of them that a test may spoil."""
    return Path(shutil.copytree(made, tmp_path / "copy", copy_function=shutil.copy2)) / "room"


def flip(path, at=0.5, decays=False):
    """Change one bit of a file; where it ``decays``, no time tells."""
    before, content = path.stat(), bytearray(path.read_bytes())
    content[int(at * (len(content) - 1))] ^= 1
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + (0 if decays else 10**9)))


def test_what_a_run_wrote_is_as_it_was_wherever_it_lies(room, capsys):
    assert changes(room) == []
    assert main(["verify", str(room)]) == 0
    assert "every file is as its run wrote it" in capsys.readouterr().out


@pytest.mark.parametrize("decays", [False, True])
def test_a_flipped_bit_is_found_in_every_kind_of_file(room, decays):
    names = {Path(name).suffix: name for name in read_provenance(room)["files"]}
    kinds = {".exr", ".npy", ".npz", ".json", ".ply", ".png", ".html", ".yaml", ".glb", ".jpg", ".safetensors", ".mp4"}
    assert names.keys() >= kinds
    for number, name in enumerate(sorted(names.values())):
        path, content, before = room / name, (room / name).read_bytes(), (room / name).stat()
        flip(path, number % 3 / 2, decays)
        assert [(each.path, each.kind) for each in changes(room)] == [(name, "decayed" if decays else "changed")]
        path.write_bytes(content)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert changes(room) == []


def test_lines_for_people(room, made, capsys):
    (room / "report.html").unlink()
    (room / "notes.txt").write_text("mine")
    flip(room / "export/scene.glb")
    flip(made / "photograph.dng")
    assert main(["verify", str(room)]) == 1
    said = capsys.readouterr().out
    flip(made / "photograph.dng")
    assert f"inputs: {made / 'photograph.dng'} was changed after the run\n" in said
    assert "export: export/scene.glb was changed after the run\n" in said
    assert "report: report.html is missing\n" in said
    assert "notes.txt: notes.txt is not of the run\n" in said
    assert said.endswith("files that differ: 4\n")


def test_relative_inputs_lie_beside_the_folder_of_results(tmp_path, monkeypatch, capsys):
    results = tmp_path / "home/results/room"
    results.mkdir(parents=True)
    (tmp_path / "home/photograph.dng").write_bytes(b"raw")
    (results / "report.html").write_text("<html>")
    monkeypatch.chdir(tmp_path / "home")
    record(Path("results/room"), {}, ["photograph.dng"])
    assert changes(Path("results/room")) == []
    monkeypatch.chdir(tmp_path)
    assert main(["verify", str(results), "--crate"]) == 0
    crate = json.loads((results / "ro-crate-metadata.json").read_text())
    identifiers = [entity["@id"] for entity in crate["@graph"]]
    assert (tmp_path / "home/photograph.dng").as_uri() in identifiers
    flip(tmp_path / "home/photograph.dng")
    assert [(each.path, each.kind) for each in changes(results)] == [("photograph.dng", "changed")]


def test_times_of_methods_are_no_results(room):
    for name in ("stats/fit.round-0.json", "logs/fit.log", "benchmarks/fit.jsonl", "round-0/model.safetensors"):
        (room / "methods/slow" / name).parent.mkdir(parents=True, exist_ok=True)
        (room / "methods/slow" / name).write_text("1")
    assert [each.path for each in changes(room)] == ["methods/slow/round-0/model.safetensors"]


def test_what_decayed_is_not_recorded_anew(room):
    flip(room / "environment.npz", decays=True)
    flip(room / "export/scene.glb")
    record(room, {}, [])
    assert [(each.path, each.kind) for each in changes(room)] == [
        ("environment.npz", "decayed"),
        ("export/scene.glb", "decayed"),  # which its manifest tells, whatever its time
    ]


def test_two_runs_are_told_apart_by_stage(room, made, capsys):
    flip(room / "round-0/model.safetensors")
    stats = {"stage": "fit", "version": 1, "settings": {"steps": 7}, "wall_s": 9.0}
    (room / "stats" / "fit.round-0.json").write_text(json.dumps(stats))
    record(room, {}, [str(made / "photograph.dng")])
    lines = list(compared(read_provenance(made / "room"), read_provenance(room)))
    assert "fit: settings.steps 5 -> 7; 1 of 1 files differ (round-0/model.safetensors)" in lines
    assert "inputs: the same bytes, 1 files" in lines
    assert [line for line in lines if ": the same bytes" not in line and not line.startswith("fit:")] == []
    assert main(["verify", str(room), "--against", str(made / "room")]) == 1
    assert "fit: settings.steps 7 -> 5" in capsys.readouterr().out


@pytest.mark.parametrize("content", [None, "{", "[]", '{"format": 1, "files": {"a": {}}, "inputs": {}, "stages": {}}'])
def test_without_a_record_one_line_says_so(room, content, capsys):
    (room / NAME).unlink()
    if content is not None:
        (room / NAME).write_text(content)
    assert main(["verify", str(room)]) == 2
    assert "finish the run: fipt run room" in capsys.readouterr().err
