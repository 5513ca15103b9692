"""``fipt bake`` and ``fipt refine``."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.formats import files
from fipt.formats.arrays import load_npz, save_npy
from fipt.scene.change import read_change
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import read_emitters, write_emitters
from fipt.scene.samples import read_samples
from fipt.scene.settled import RoundState, write_state
from fipt.scene.shading import read_shading
from fipt.stages.shade import refine
from tests.fitted import call


def test_shading_fits_its_samples(scene):
    samples = read_samples(scene / "samples" / "train-000")
    cache = load_npz(scene / "cache.npz")
    for k in (0, 1):
        shading = read_shading(scene / f"round-{k}" / "shading" / "train-000")[:]
        assert shading.shape == (len(samples.position), SHADING_OUTPUTS, 3)
        assert np.isfinite(shading).all()
        assert 0.05 < shading[:, 0].mean() < cache["radiance"].max()


def test_shards_of_one_view_give_the_same_shading(scene, tmp_path):
    """Results do not depend on the size of shards."""
    both = read_shading(scene / "round-0" / "shading" / "train-000")
    samples = read_samples(scene / "samples" / "train-000")
    for index, view in enumerate("ab"):
        assert call("samples", scene, "--views", view, "--out", tmp_path / "samples" / view) == 0
        assert call("bake", scene, "--samples", tmp_path / "samples" / view, "--out", tmp_path / "bake" / view) == 0
        np.testing.assert_array_equal(read_shading(tmp_path / "bake" / view)[:], both[samples.of_view(index)])


def test_a_refinement_says_what_it_changed(scene):
    assert json.loads((scene / "stats" / "refine.json").read_text())["round"] == 1
    change = read_change([scene / "round-1" / "shading" / "train-000"])
    assert 0 <= change.kept <= 0.5
    assert change.change >= 0


def test_every_round_has_random_numbers_of_its_own(work):
    for number in (1, 2):
        write_state(work / "settled.json", RoundState(number))
        assert call("refine", work, "--settled", work / "settled.json", "--out", work / f"after-{number}") == 0
    first, second = (read_shading(work / f"after-{number}")[:] for number in (1, 2))
    assert np.any(first != second)


@pytest.mark.parametrize(("moved", "anew"), [(0.5, True), (0.0, False)])
def test_a_guess_after_a_round_without_light_begins_anew(work, monkeypatch, moved, anew):
    """Its shading and materials are those of the cache's light."""
    found = read_emitters(work / "round-0" / "emitters.npz")
    guess = replace(found, guessed=np.ones(len(found.triangle), bool))
    write_emitters(work / "guess" / "emitters.npz", guess, Dataset(work / "dataset").mesh())
    write_state(work / "settled.json", RoundState(1, light_missing=1.0, kept=1.0, moved=moved))
    told, make = [], refine.fitted_shader
    monkeypatch.setattr(
        refine, "fitted_shader", lambda *room, filled: told.append(filled) or make(*room, filled=filled)
    )
    before = work / "round-1" / "shading" / "train-000"
    options = ("--previous", before, "--settled", work / "settled.json", "--emitters", work / "guess" / "emitters.npz")
    assert call("refine", work, *options, "--out", work / "after") == 0
    assert told == [anew]
    assert (read_change([work / "after"]).kept == 0) == anew


def test_shading_of_other_samples(work, refused):
    shading = read_shading(work / "round-0" / "shading" / "train-000")
    save_npy(work / "other" / "shading.npy", shading.words[:-3])
    assert "must hold shading of shape" in refused("fit", "--shading", work / "other")
    assert "shading" in refused("emitters", "--shading", work / "other")
    assert "shading" in refused("refine", "--previous", work / "other")


def test_a_cache_that_is_something_else(work, refused):
    assert "emitters.npz" in refused("bake", "--cache", work / "round-0" / "emitters.npz")


def test_a_disk_that_is_too_small(work, refused, monkeypatch, capsys):
    monkeypatch.setattr(files.shutil, "disk_usage", lambda place: SimpleNamespace(free=1000))
    for verb in ("bake", "refine"):
        assert f"the {verb} shading needs" in refused(verb)


def seen_as_truth(data, view):
    """The lamp is what is bright in a photograph; all else is grey."""
    photo, _ = data.image(view)
    bright = photo.max(axis=-1) > 0.5 * photo.max()
    grey = np.full_like(photo, 0.5)
    layers = {"base_color": grey, "roughness": grey[..., 0], "metallic": 0 * grey[..., 0]}
    return layers | {"emission": np.where(bright[..., None], photo, 0)}


def test_shading_of_the_true_room(scene, tmp_path, refused, monkeypatch):
    monkeypatch.setattr(Dataset, "truth", seen_as_truth)
    settings = {"truth": True, "diffuse_spp": 8, "specular_spp": 2, "smooth_spp": 2, "denoise": False}
    out, samples = tmp_path / "true" / "train-000", scene / "samples" / "train-000"
    assert call("bake", scene, "--true-samples", samples, "--out", out, settings=settings) == 0
    true, baked = (read_shading(path)[:][:, 0].mean() for path in (out, scene / "round-0" / "shading" / "train-000"))
    assert 0.5 < true / baked < 2
    assert "bake.truth needs the samples" in refused("bake", settings=settings)
