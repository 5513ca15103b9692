"""The fit's networks by gradients of the tracer: what they learn, and that it is written as a field."""

import json

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.model.networks import Field, SceneBox
from fipt.model.settings import NetworkSettings
from fipt.stages.inverse_trace.field import FieldOptimiser
from fipt.stages.inverse_trace.settings import InverseTraceSettings

SMALL = NetworkSettings(levels=6, table_log2=10, whitest=1)


def test_networks_learn_what_their_gradients_say(backend):
    place = np.random.default_rng(0).uniform(-1, 1, (400, 3)).astype(np.float32)
    found = FieldOptimiser(Field(SMALL, SceneBox((0, 0, 0), 2.1)), place, 0.1, 2, 1.0)
    base = np.where(place[:, :1] > 0, 0.8, 0.2) * np.ones(3)  # an edge, which only the encoding can follow
    first = found.values()
    assert first["emission"].shape == (2, 3)
    assert (first["roughness"].mean() > 0.7, first["metallic"].mean() < 0.1) == (True, True)
    settings = InverseTraceSettings(learning_rate=5e-3)
    for step in range(60):
        now = found.values()
        slopes = {name: np.zeros_like(now[name]) for name in now}
        slopes["base_color"] = 2 * (now["base_color"] - base) / base.size
        slopes["roughness"] = 2 * (now["roughness"] - 0.4) / len(base)
        slopes["emission"] = np.array([[-1.0] * 3, [0.0] * 3])  # the first group must be brighter
        found.step(slopes, settings, step / 60)
    values = found.values()
    assert np.abs(values["base_color"] - base).mean() < 0.08
    assert np.abs(values["roughness"] - 0.4).mean() < 0.05
    assert values["emission"][0, 0] > 2 * first["emission"][0, 0]
    assert values["emission"][1] == pytest.approx(first["emission"][1])


def test_networks_need_texels(tmp_path, capsys):
    options = [f"--{name}={tmp_path / name}" for name in ("dataset", "samples", "out", "emitters-out")]
    assert main(["inverse-trace", *options, "--settings", json.dumps({"field": True})]) == 2
    line = capsys.readouterr().err.strip()
    assert ("inverse_trace.field needs texels" in line, "\n" in line) == (True, False)
