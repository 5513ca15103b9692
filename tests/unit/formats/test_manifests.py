"""Manifests and the figures of a run."""

import json
from pathlib import Path

import pytest

from fipt.errors import FiptError
from fipt.formats.manifests import file_hash, read_manifest, recorded, write_manifest
from fipt.registry import VERSIONS


def test_round_trip_and_no_time_stamp(tmp_path: Path) -> None:
    files = [tmp_path / "shard" / name for name in ("b.npy", "a.npy")]
    files[0].parent.mkdir()
    for file in files:
        file.write_text(file.name)
    path = tmp_path / "shard.manifest.json"
    write_manifest(path, "samples", files, {"grid": 4})
    first = path.read_bytes()
    content = read_manifest(path, "samples")
    assert content["settings"] == {"grid": 4}
    assert content["version"] == VERSIONS["samples"]
    assert content["files"] == {f"shard/{file.name}": file_hash(file) for file in files}
    write_manifest(path, "samples", reversed(files), {"grid": 4})
    assert path.read_bytes() == first
    files[0].write_text("changed")
    write_manifest(path, "samples", files, {"grid": 4})
    assert path.read_bytes() != first


def test_another_stage_or_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    write_manifest(path, "samples", [], {})
    with pytest.raises(FiptError, match=r"must be of stage bake .*; found samples version"):
        read_manifest(path, "bake")
    path.write_text(json.dumps({**json.loads(path.read_text()), "version": 99}))
    with pytest.raises(FiptError, match="found samples version 99; run that stage again"):
        read_manifest(path, "samples")


@pytest.mark.parametrize("text", ["", "[]", "{}"])
def test_a_damaged_manifest_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(FiptError, match=r"m\.json is not a manifest"):
        read_manifest(tmp_path / "m.json", "samples")
    with pytest.raises(FiptError, match="the manifest of stage samples is missing"):
        read_manifest(tmp_path / "none.json", "samples")


def test_stats_hold_time_memory_and_figures(tmp_path: Path) -> None:
    with recorded(tmp_path / "s.json", "samples", {"grid": 4}) as stats:
        stats["rays"] = 12
    content = json.loads((tmp_path / "s.json").read_text())
    assert content["rays"] == 12
    assert content["wall_s"] >= 0
    assert content["peak_memory_bytes"] > 1_000_000
    assert content["settings"] == {"grid": 4}


def test_a_failed_run_leaves_no_stats(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="bad"), recorded(tmp_path / "s.json", "samples", {}):
        raise ValueError("bad")
    with recorded(None, "samples", {}):
        pass
    assert list(tmp_path.iterdir()) == []
