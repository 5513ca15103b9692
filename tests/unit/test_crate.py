"""A folder of results as an RO-Crate."""

import json

import pytest

from fipt.cli.main import main
from fipt.crate import CRATE
from fipt.formats.manifests import file_hash
from fipt.provenance import mark_tidied, record


@pytest.fixture
def room(tmp_path):
    """Results of two stages, and an input."""
    results = tmp_path / "room"
    (results / "stats").mkdir(parents=True)
    for name in ("cache.npz", "metrics.json", "relight of mine.png"):
        (results / name).write_text(name)
    (tmp_path / "photo.dng").write_text("raw")
    stats = {"stage": "cache", "version": 3, "settings": {"resolution": 64}, "wall_s": 1.0}
    (results / "stats" / "cache.json").write_text(json.dumps(stats))
    record(results, {}, [str(tmp_path / "photo.dng")])
    return results


def graph(room):
    """Entities of the crate by their ids; they refer to nothing else."""
    found = {entity["@id"]: entity for entity in json.loads((room / CRATE).read_text())["@graph"]}
    named = {item["@id"] for entity in found.values() for value in entity.values() if isinstance(value, list)
             for item in value if isinstance(item, dict)}  # fmt: skip
    assert named <= found.keys()
    return found


def test_a_verified_run_is_a_crate(room):
    assert main(["verify", str(room), "--crate"]) == 0
    found = graph(room)
    assert found[CRATE]["about"] == {"@id": "./"}
    assert {"@id": "relight%20of%20mine.png"} in found["./"]["hasPart"]
    assert found["cache.npz"]["sha256"] == file_hash(room / "cache.npz")
    assert found[(room.parent / "photo.dng").as_uri()]["contentSize"] == "3"
    assert found["#cache"]["result"] == [{"@id": "cache.npz"}]
    assert json.loads(found["#cache-settings"]["value"])["settings"] == {"resolution": 64}
    assert main(["verify", str(room)]) == 0  # the crate is no file of the run


def test_files_that_were_removed_on_purpose_are_no_part(room):
    mark_tidied(room, ["cache.npz"])
    (room / "cache.npz").unlink()
    assert main(["verify", str(room), "--crate"]) == 0
    assert "cache.npz" not in graph(room)


def test_a_run_that_was_changed_is_no_crate(room):
    (room / "metrics.json").write_text("better")
    assert main(["verify", str(room), "--crate"]) == 1
    assert not (room / CRATE).exists()
