"""A small random Mask2Former as the workflow calls it, offline: ids by view, fused, and fitted with."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import tiny_mask2former
from benchmarks.jobs import run_all
from fipt.formats.images import read_ids
from fipt.scene.segments import read_view_ids
from tests.fitted import kept_threads
from tests.workflow.prepared import jobs_of

pytestmark = pytest.mark.slow

CONFIG = {
    "scenes": {"room": {"source": "procedural"}},
    "rounds": 0,
    "views_per_shard": 8,
    "synthesize": {"train_views": 4, "val_views": 1, "width": 48, "height": 36, "spp": 8},
    "samples": {"grid": 1},
    "cache": {"resolution": 32},
    "bake": {"diffuse_spp": 4, "specular_spp": 2, "smooth_spp": 2},
    "fit": {"steps": 20, "batch": 256, "levels": 4, "table_log2": 10},
}


def test_a_network_segments_a_room(backend, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("HTTPS_PROXY", "HTTP_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")  # nobody listens
    model = tiny_mask2former.save(tmp_path / "model")
    config = {**CONFIG, "segment": {"mode": "mask2former", "model": str(model), "overlap": 0}}
    with kept_threads():
        assert run_all(jobs_of(tmp_path, config, "results/room/round-0/model.safetensors")) == 0

    segments = Path("results/room/segments")
    assert json.loads((segments / "classes.json").read_text())["8"] == "class 7"
    views = sorted(path.stem for path in (segments / "views").iterdir())
    assert views == [f"train_{k:03d}" for k in range(4)]
    agree = []
    for view in views:
        ids, classes = read_view_ids(segments / "views" / f"{view}.npz")
        fused = read_ids(segments / "fused" / "semantic" / f"{view}.png")
        assert len(np.unique(ids)) > 2
        agree.append(classes[ids][ids > 0] == fused[ids > 0])
    # A random network says different things of one place in different views; the fused class is what most say (0.7).
    assert np.concatenate(agree).mean() > 0.4
    fit = json.loads(Path("results/room/stats/fit.round-0.json").read_text())
    assert fit["segments"] == "part"
    assert fit["fused_segments"] is True
    assert len(fit["parts"]) > 3
