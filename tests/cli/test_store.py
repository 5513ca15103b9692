"""What `fipt run --store` keeps in the storage when Snakemake has ended."""

import os
from pathlib import Path

import pytest
import typer

from fipt.cli import run, run_view
from fipt.errors import EXIT_CODE
from tests.buckets import empty_bucket

SCENES = "scenes={a: {source: procedural}, b: {source: procedural}}"


@pytest.fixture
def bucket(tmp_path, monkeypatch):
    """A bucket of moto, and an empty working directory."""
    with empty_bucket("s3://rooms", tmp_path, monkeypatch) as made:
        yield made


def write(path: str, text: str) -> Path:
    """Write a file."""
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def ended(monkeypatch, scenes, does, code) -> None:
    """Run scenes with something in place of Snakemake."""

    def instead(*args, **named):
        does()
        return code

    monkeypatch.setattr(run, "snakemake", instead)
    monkeypatch.setattr(run_view, "jobs_failed", lambda: code == EXIT_CODE)
    with pytest.raises(typer.Exit) as said:
        run.command([*scenes, "capture"], config=[SCENES], store="s3://rooms")
    assert said.value.exit_code == code


def test_decisions_of_a_person_during_a_run_stay_and_are_stored(bucket, monkeypatch):
    review = write("results/a/emitters_review.yaml", "mesh_triangles: 0\n")
    bucket.put([review])

    def decide():
        review.write_text("mesh_triangles: 0\nemitters: []\n")
        os.utime(review, (review.stat().st_mtime + 100,) * 2)

    ended(monkeypatch, ["a"], decide, 0)
    assert review.read_text() == "mesh_triangles: 0\nemitters: []\n"
    assert bucket.read(review) == review.read_bytes()


def test_of_several_rooms_those_that_ended_well_are_stored_whole(bucket, monkeypatch):
    def fail():
        write("results/a/stats/one.json", "{}")
        write("results/a/logs/one.log", "")
        write("results/b/logs/one.log", "fipt: error: no light; add some")

    ended(monkeypatch, ["a", "b"], fail, EXIT_CODE)
    assert set(bucket.files("results")) == {"results/a/provenance.json"}
