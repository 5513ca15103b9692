"""A small random Mask2Former through the real Snakefile, offline: ids by view, fused, and fitted with."""

import json

import numpy as np
import pytest

from benchmarks import tiny_mask2former
from fipt.formats.images import read_ids
from fipt.scene.segments import read_view_ids

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


@pytest.mark.slow
def test_a_network_segments_a_room(workspace):
    here = workspace(CONFIG, stand_in=False)
    model = tiny_mask2former.save(here.root / "model")
    here.configure({**CONFIG, "segment": {"mode": "mask2former", "model": str(model), "overlap": 0}})
    here.environment |= {"HTTPS_PROXY": "http://127.0.0.1:9", "HTTP_PROXY": "http://127.0.0.1:9"}  # nobody listens
    here.snakemake("results/room/round-0/model.safetensors")

    segments = here.root / "results/room/segments"
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
    fit = json.loads((here.root / "results/room/stats/fit.round-0.json").read_text())
    assert fit["segments"] == "part"
    assert fit["fused_segments"] is True
    assert len(fit["parts"]) > 3
