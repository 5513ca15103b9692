"""What a run needs of the machine is known before its first job."""

from types import SimpleNamespace

import pytest

from fipt.config import read
from fipt.config.machine import PlannedJob, check_machine
from fipt.config.resources import PIXELS, WRITTEN
from fipt.errors import FiptError
from fipt.formats import files


@pytest.fixture
def jobs(tmp_path, monkeypatch):
    """Jobs of a room in code: eight views of 1000x1000, shards of 4."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").mkdir()
    size = "{train_views: 8, val_views: 1, width: 1000, height: 1000}"
    text = f"scenes: {{room: {{source: procedural}}}}\nviews_per_shard: 4\nsynthesize: {size}\n"
    (tmp_path / "config" / "config.yaml").write_text(text)
    scene = read().scenes["room"]

    def make(fresh=True):
        shards = ("train-000", "train-001")
        return [PlannedJob("samples", scene, shard, rays=True, fresh=fresh) for shard in shards]

    return make


def test_a_disk_that_is_too_small_for_all_jobs_together(jobs, monkeypatch):
    needed = WRITTEN["samples"] * 8_000_000
    monkeypatch.setattr(files.shutil, "disk_usage", lambda place: SimpleNamespace(free=int(0.8 * needed)))
    with pytest.raises(FiptError, match=r"a run of 2 jobs needs 640\.0 MB in results; 512\.0 MB are free"):
        check_machine(jobs(), here=False)
    check_machine(jobs()[:1], here=False)
    check_machine(jobs(fresh=False), here=False)  # what they replace makes room


def test_images_of_unknown_size_are_no_reason_to_refuse(monkeypatch, jobs):
    monkeypatch.setattr(type(jobs()[0].scene.source), "pixels", PIXELS)
    assert jobs()[0].scene.known_work("train-000") is None
    monkeypatch.setattr(files.shutil, "disk_usage", lambda place: SimpleNamespace(free=10**6))
    check_machine(jobs(), here=False)


def test_a_machine_without_a_device_for_rays(tmp_path, jobs, monkeypatch):
    (tmp_path / "libLLVM.so").write_text("no library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "libLLVM.so"))
    monkeypatch.setenv("FIPT_BACKEND", "llvm")
    with pytest.raises(FiptError, match="which is not LLVM"):
        check_machine(jobs(), here=True)
    check_machine(jobs(), here=False)  # a node of a cluster may have one
