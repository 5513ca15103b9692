"""``fipt fit``: killed and resumed, bad input."""

import json
import shutil

import pytest
import torch

from fipt.model import store
from fipt.scene.dataset import Dataset
from fipt.stages.fit.objective import Objective
from tests.fitted import FEW, FIT, call


def test_the_fit_knows_unseen_surface(scene):
    content = json.loads((scene / "stats" / "fit.json").read_text())
    assert {"target", "base", "hidden"} <= set(content["loss"])
    assert content["loss"]["hidden"] > 0


def test_a_mask_is_fitted_where_no_emitters_are_given(work):
    assert store.load_field(work / "round-0" / "model.safetensors").emission_network is not None
    few = FIT | {"steps": 3}
    emitters = work / "round-0" / "emitters.npz"
    stats = work / "stats" / "fit.json"
    assert call("fit", work, "--emitters", emitters, settings=few, stats=stats) == 0
    assert store.load_field(work / "round-0" / "model.safetensors").emission_network is None
    assert "emission" not in json.loads(stats.read_text())["loss"]


def test_a_mask_that_is_asked_must_be_there(work, refused):
    assert call("fit", work, "--emitters", work / "round-0" / "emitters.npz", settings=FIT | {"steps": 3}) == 0
    assert "needs a model with an emission mask" in refused("emitters", "--out", work / "again.npz")


def test_shards_that_do_not_pair_up(work, refused):
    two = f"{work}/samples/train-000,{work}/samples/val-000"
    assert "--samples and --shading must name as many shards; 2 and 1 given" in refused("fit", "--samples", two)
    assert "shards" in refused("emitters", "--samples", two)
    first = f"{work}/round-0/shading/train-000,{work}/samples/val-000"
    assert "--samples and --first-shading must name as many" in refused("fit", "--first-shading", first)


class Killed(Exception):
    """Stands for kill -9 after some step."""


@pytest.fixture
def killed(work, monkeypatch):
    """The results after a fit that was killed in its 30th step; the settings of that fit."""
    original, calls = Objective.terms, []

    def later(*given):
        calls.append(1)
        if len(calls) == 30:
            raise Killed
        return original(*given)

    settings = FIT | {"checkpoint_every": 10}
    (work / "round-0" / "model.safetensors").unlink()
    monkeypatch.setattr(Objective, "terms", later)
    with pytest.raises(Killed):
        call("fit", work, settings=settings)
    monkeypatch.setattr(Objective, "terms", original)
    assert len(list((work / "round-0").glob("model*"))) == 1  # the checkpoint, and no model
    return settings


def test_a_killed_fit_goes_on_and_gives_the_same_model(work, killed, scene, capsys):
    assert call("fit", work, settings=killed) == 0
    assert "going on from step 20" in capsys.readouterr().err
    assert [path.name for path in (work / "round-0").glob("model*")] == ["model.safetensors"]
    whole, resumed = (store.load_field(root / "round-0" / "model.safetensors").state_dict() for root in (scene, work))
    assert all(torch.equal(value, resumed[name]) for name, value in whole.items())


@pytest.mark.parametrize("change", ["settings", "inputs", "dataset"])
def test_a_checkpoint_of_another_fit_is_not_used(work, killed, change, capsys):
    if change == "inputs":
        assert call("bake", work, settings=FEW | {"seed": 3}) == 0
    if change == "dataset":
        image = work / "dataset" / "images" / f"{Dataset(work / 'dataset').views('train')[0]}.exr"
        image.with_name("copy").write_bytes(image.read_bytes())
        image.with_name("copy").replace(image)
    assert call("fit", work, settings=killed | ({"seed": 3} if change == "settings" else {})) == 0
    assert "going on" not in capsys.readouterr().err
    assert [path.name for path in (work / "round-0").glob("model*")] == ["model.safetensors"]


def test_files_of_another_version(work, killed, refused, monkeypatch):
    shutil.copy(next((work / "round-0").glob("model*")), work / "model.safetensors")
    assert "is a checkpoint of the fit, not a field" in refused("materials", "--model", work / "model.safetensors")
    monkeypatch.setitem(store.VERSIONS, "fit", 99)
    assert "this is version 99; delete it and run the fit again" in refused("fit", settings=killed)


def test_without_segments_the_fit_says_so(work, capsys):
    shutil.rmtree(work / "dataset" / "segments")
    assert call("fit", work, settings=FIT | {"steps": 2}) == 0
    assert "warning: no segments" in capsys.readouterr().err
