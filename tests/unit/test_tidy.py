"""What a finished room no longer needs goes; what is left is as it was."""

import os

import pytest

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.manifests import write_manifest
from fipt.provenance import changes, record
from fipt.tidy import restore, tidy


@pytest.fixture
def results(tmp_path):
    """A room with samples and the shading of two rounds, the second of which is a copy of the first."""
    folder = tmp_path / "room"
    for place, stage in (("samples/train-000", "samples"), ("round-0/shading/train-000", "bake")):
        file = folder / place / "values.npy"
        write_text(file, "x" * 1000)
        write_manifest(folder / f"{place}.manifest.json", stage, [file], {})
    copy = folder / "round-1/shading/train-000/values.npy"
    copy.parent.mkdir(parents=True)
    os.link(folder / "round-0/shading/train-000/values.npy", copy)
    write_manifest(folder / "round-1/shading/train-000.manifest.json", "refine", [copy], {})
    write_text(folder / "round-1/model.safetensors", "m" * 10)
    write_text(folder / "report.html", "page")
    record(folder, {}, [])
    return folder


def test_what_goes_is_told_and_goes(results):
    planned = tidy(results, dry=True)
    assert planned.before - planned.after == sum(planned.sizes.values())
    assert (results / "samples/train-000/values.npy").is_file()
    done = tidy(results, dry=False)
    assert done == planned
    assert set(done.sizes) == {"footprint samples", "shading"}
    assert done.sizes["shading"] == 1000  # two names of one file
    left = sorted(str(path.relative_to(results)) for path in results.rglob("*") if path.is_file())
    manifests = [f"{place}/train-000.manifest.json" for place in ("round-0/shading", "round-1/shading", "samples")]
    assert left == sorted([".lock", "provenance.json", "report.html", "round-1/model.safetensors", *manifests])
    assert restore(results) == manifests
    assert restore(results) == []


def test_a_tidied_room_is_verified(results):
    tidy(results, dry=False)
    assert changes(results) == []
    record(results, {}, [])
    assert changes(results) == []
    write_text(results / "round-1/model.safetensors", "n" * 10)
    assert [each.path for each in changes(results)] == ["round-1/model.safetensors"]


def test_a_room_that_is_not_done_stays(results):
    write_text(results / "logs/fit.round-1.log", "fipt: error: no")
    with pytest.raises(FiptError, match="is not done"):
        tidy(results, dry=False)
    (results / "logs/fit.round-1.log").unlink()
    (results / "report.html").unlink()
    with pytest.raises(FiptError, match="is not done"):
        tidy(results, dry=False)
    assert (results / "samples/train-000/values.npy").is_file()
