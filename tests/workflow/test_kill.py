"""A verb killed in the middle leaves nothing that looks finished; run again, all is the same."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from benchmarks.jobs import REPOSITORY, Job
from tests.fitted import kept_threads
from tests.workflow.prepared import jobs_of

CONFIG = {
    "scenes": {"room": {"source": "procedural"}},
    "rounds": 0,
    "synthesize": {"train_views": 4, "val_views": 1, "width": 48, "height": 36, "spp": 4},
    "samples": {"grid": 1},
    "cache": {"resolution": 32},
    # Long enough to be killed in the middle, short enough to be repeated.
    "bake": {"diffuse_spp": 1024, "specular_spp": 128, "smooth_spp": 128, "denoise": False},
    "fit": {"steps": 100, "batch": 256, "levels": 4, "table_log2": 10, "checkpoint_every": 20},
}

pytestmark = pytest.mark.slow


def start(job: Job, folder: Path) -> subprocess.Popen:
    """Start a job's verb in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "fipt.cli.main", job.verb, *job.options],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(job: Job, folder: Path) -> None:
    """Run a job's verb to its end."""
    running = start(job, folder)
    _, errors = running.communicate(timeout=300)
    assert running.returncode == 0, errors


def finish_here(job: Job, folder: Path) -> None:
    """Run a job's verb to its end in this process, which saves the start of another."""
    with chdir(folder), kept_threads():
        assert job.run() == 0


def kill_when(job: Job, folder: Path, ready: Callable[[], bool]) -> None:
    """Start a job and kill it once ``ready()``, or let it end before."""
    running = start(job, folder)
    end = time.monotonic() + 200
    while not ready() and running.poll() is None:
        assert time.monotonic() < end, "the job never came this far"
        time.sleep(0.02)
    running.kill()  # SIGKILL
    running.communicate()


@pytest.fixture(scope="module")
def room(tmp_path_factory, backend):
    """Folder and jobs by label; everything before the bake is done."""
    folder = tmp_path_factory.mktemp("kill")
    jobs = {job.label: job for job in jobs_of(folder, CONFIG)}
    labels = ("synthesize", "synthesize.train-000", "samples.train-000", "cache", "environment")
    for label in labels:
        finish_here(jobs[label], folder)
    return folder, jobs


def test_bake(room):
    folder, jobs = room
    job = jobs["bake.round-0.train-000"]
    shading, manifest = folder / job.outputs[0] / "shading.npy", folder / job.outputs[1]
    begin = time.monotonic()
    finish(job, folder)
    duration = time.monotonic() - begin
    expected = manifest.read_text(), shading.read_bytes()

    def clear():
        manifest.unlink()
        shutil.rmtree(shading.parent)

    clear()
    halves = 0
    for share in (0.5, 0.75, 1.0):  # each works on what the one before has left
        end = time.monotonic() + share * duration
        kill_when(job, folder, lambda end=end: time.monotonic() > end)
        if manifest.exists():  # it was faster than before: then everything is there
            assert (manifest.read_text(), shading.read_bytes()) == expected
            clear()
        else:
            halves += 1
    finish_here(job, folder)
    assert (manifest.read_text(), shading.read_bytes()) == expected
    assert halves


def test_fit(room):
    folder, jobs = room
    if not (folder / jobs["bake.round-0.train-000"].outputs[1]).exists():
        finish_here(jobs["bake.round-0.train-000"], folder)
    finish_here(jobs["emitters.round-0"], folder)
    job = jobs["fit.round-0"]
    finish_here(job, folder)
    model = folder / job.outputs[0]
    expected = load_file(model)
    model.unlink()

    def checkpoints():
        return list(model.parent.glob("model.checkpoint-*.safetensors"))

    assert not checkpoints()
    kill_when(job, folder, checkpoints)
    assert checkpoints()
    assert not model.exists()

    finish_here(job, folder)
    found = load_file(model)
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert not checkpoints()
