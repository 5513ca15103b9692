"""The real Snakefile on a tiny room, two rounds, judged by thresholds."""

import json

import pytest

CONFIG = {
    "scenes": {
        "room": {
            "source": "procedural",
            "setups": {
                "dim": {"emitters": [{"scale": 0.4}]},
                "walk": {"cameras": {"path": {"keyframes": ["train_000", "val_001"], "frames": 2}}},
            },
        }
    },
    "rounds": 1,
    "views_per_shard": 8,
    "synthesize": {"train_views": 8, "val_views": 2, "width": 32, "height": 24, "spp": 32},
    "samples": {"grid": 2},
    "cache": {"resolution": 64},
    "bake": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4},
    "refine": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4},
    "fit": {"steps": 300, "batch": 512, "levels": 8, "table_log2": 14},
    "render": {"spp": 16},
    "relight": {"spp": 16},
}

KD_PSNR = 14.0
"""dB on held-out views, linear: measured 16.8 when this was written."""

RENDER_PSNR = 17.0
"""dB, tone-mapped, mean over held-out views, in their own light (measured 20.5) and dimmed."""


def figures(folder):
    return json.loads((folder / "results/room/metrics.json").read_text())


@pytest.mark.slow
def test_finds_materials_and_lamps_of_a_room(workspace):
    here = workspace(CONFIG, stand_in=False)
    here.fipt_run()
    assert here.planned() == {}

    found = figures(here.root)
    assert found["val"]["kd_psnr"] > KD_PSNR
    assert found["val"]["render_psnr"] > RENDER_PSNR
    assert found["relight"]["dim"]["relight_psnr"] > RENDER_PSNR
    listed = json.loads((here.root / "results/room/round-1/emitters.json").read_text())
    assert listed["emitters"]
    assert found["val"]["emission_iou"] > 0.8
    page = (here.root / "results/room/report.html").read_text()
    assert "<img" in page
    assert "data:video/mp4" in page
    assert len(list(here.root.glob("results/room/relight/walk/frame-*.png"))) == 2
    assert not list(here.root.rglob("*.tmp*"))
