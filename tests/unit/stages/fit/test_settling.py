"""A loop that runs until it has settled: the figure, and rounds that are copies."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.scene.change import ShadingChange
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import read_emitters, write_emitters
from fipt.scene.settled import RoundState, read_state, write_state
from fipt.stages.fit import settling
from tests import scenes
from tests.fitted import FIT, SHADING, call

FEW_STEPS = FIT | {"steps": 2}


def later(work, monkeypatch, number, found, *more):
    """Fit round ``number`` of a loop whose shading changed so."""
    monkeypatch.setattr(settling, "read_change", lambda folders: found)
    folder = work / f"round-{number}"
    write_state(work / "before.json", RoundState(number - 1))
    options = ("--previous", work / "round-0/model.safetensors", "--settled", work / "before.json", *more)
    assert call("fit", work, *options, "--out", folder / "model.safetensors", settings=FEW_STEPS) == 0
    return read_state(folder / "settled.json")


def test_the_first_round_has_not_settled(scene):
    assert read_state(scene / "round-0" / "settled.json") == RoundState(0)


@pytest.mark.parametrize(
    ("number", "change", "settled"), [(1, 0.01, None), (2, 0.06, None), (2, 0.04, 2), (3, 0.04, 3)]
)
def test_settled_where_noise_is_more_than_the_change(work, monkeypatch, capsys, number, change, settled):
    state = later(work, monkeypatch, number, ShadingChange(change, 0.05, 0.3))
    assert (state.round, state.settled) == (number, settled)
    assert (state.change, state.noise, state.kept) == (change, 0.05, 0.3)
    assert state.kd_change > 0
    said = capsys.readouterr().err
    assert f"round {number}: shading changed by {100 * change:.1f} % (noise 5.0 %), 0.0 % of the light" in said
    assert said.count("not settled yet") == (settled is None)


@pytest.mark.parametrize("found", [ShadingChange(0.04, 0.05, 0.3), ShadingChange(0.9, 0.05, 1.0, light_missing=True)])
@pytest.mark.parametrize(("factor", "moved", "settled"), [(1.02, 0.0196, 2), (1.25, 0.2, None)])
def test_a_loop_whose_emitters_change_has_not_settled(work, monkeypatch, factor, moved, settled, found):
    """The shading was made with those of the round before: what is found since lights nothing yet."""
    before = work / "round-0" / "emitters.npz"
    lamp = read_emitters(before)
    brighter = replace(lamp, radiance=lamp.radiance * np.float32(factor))
    write_emitters(work / "now" / "emitters.npz", brighter, Dataset(work / "dataset").mesh())
    more = ("--emitters", work / "now" / "emitters.npz", "--emitters-before", before)
    state = later(work, monkeypatch, 2, found, *more)
    assert state.moved == pytest.approx(moved, abs=1e-3)
    assert state.settled == settled


def test_a_round_that_found_light_missing_does_not_call_itself_settled(work, monkeypatch, capsys):
    state = later(work, monkeypatch, 2, ShadingChange(0.9, 0.05, 1.0, light_missing=True))
    assert (state.settled, state.light_missing, state.kept) == (2, 1.0, 1.0)
    said = capsys.readouterr().err
    assert "the shading of the round before stays, since the emitters that were found give too little light" in said
    assert "settled" not in said.replace("settled.json", "")


def test_later_rounds_are_copies(work):
    write_state(work / "settled.json", RoundState(2, 2, 0.01, 0.05, 0.001))
    given = ("--settled", work / "settled.json")
    model, folder = work / "round-0" / "model.safetensors", work / "round-3"
    stats = work / "stats.json"
    options = ("--previous", model, *given, "--out", folder / "model.safetensors")
    assert call("fit", work, *options, stats=stats) == 0
    for name in ("model.safetensors", "confidence.npz"):
        assert (folder / name).read_bytes() == model.with_name(name).read_bytes()
    assert read_state(folder / "settled.json") == RoundState(3, 2, 0.01, 0.05, 0.001)
    assert {"copied": True, "settled_in_round": 2}.items() <= json.loads(stats.read_text()).items()

    shading = folder / "shading" / "train-000"
    assert call("refine", work, *given, "--out", shading, stats=stats) == 0
    assert (shading / "shading.npy").read_bytes() == (work / SHADING / "shading.npy").read_bytes()
    assert json.loads(stats.read_text())["copied"] is True
    manifest = json.loads(shading.with_name("train-000.manifest.json").read_text())
    assert manifest["stage"] == "refine"

    emitters = work / "round-0" / "emitters.npz"
    options = ("--previous", emitters, *given, "--out", folder / "emitters.npz")
    assert call("emitters", work, *options, stats=stats) == 0
    for suffix in (".npz", ".json"):
        assert (folder / f"emitters{suffix}").read_bytes() == emitters.with_suffix(suffix).read_bytes()
    assert json.loads(stats.read_text())["copied"] is True


def test_a_copy_needs_something_to_copy(work, refused):
    write_state(work / "settled.json", RoundState(2, 2))
    assert "--previous is missing" in refused("fit", "--settled", work / "settled.json")


class Placed:
    """A field whose kd is the place that it was asked about, times a factor."""

    def __init__(self, factor):
        self._factor = factor

    def place(self, points, normals):
        return points - normals

    def query(self, places, footprint):
        return SimpleNamespace(kd=self._factor * places)


def test_surface_is_asked_on_the_side_that_it_faces(monkeypatch):
    cache = scenes.grid() | {"facing": np.uint8([1, 3, 5, 1, 3, 5, 1, 3])}
    monkeypatch.setattr(settling, "read_cache", lambda path: cache)
    change = settling._kd_change(SimpleNamespace(cache="cache.npz"), Placed(1), Placed(0))
    normals = np.eye(3)[[0, 1, 2, 0, 1, 2, 0, 1]]
    assert change == pytest.approx(np.sqrt(np.mean(np.square(cache["point"] - normals))), abs=1e-5)
