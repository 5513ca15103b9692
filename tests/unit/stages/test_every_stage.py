"""What holds for every stage: figures, manifests, the same again, and one line for bad input."""

import itertools
import json
import os
from pathlib import Path

import numpy as np
import pytest

from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.manifests import read_manifest
from tests.fitted import SETTINGS, call, content, manifest_of, values


def test_a_run_leaves_what_its_stages_say(scene):
    """Every file is an input, is the file that an option names, stands in a manifest, or comes beside an output."""
    known = {str(name) for verb in SETTINGS for name in values(verb).values() if isinstance(name, Path)}
    for path in scene.rglob("*.manifest.json"):
        beside = path.relative_to(scene).parent
        known |= {str(path.relative_to(scene)), *(str(beside / name) for name in _listed(path))}
    found = {str(path.relative_to(scene)) for path in scene.rglob("*") if path.is_file()}
    left = {name for name in found - known if not name.startswith(("dataset/", "stats/", "findings/"))}
    assert left == {"round-0/emitters.json", "round-0/settled.json"}


def _listed(path):
    return json.loads(path.read_text())["files"]


@pytest.mark.parametrize("verb", [verb for verb in SETTINGS if manifest_of(verb) is not None])
def test_a_manifest_names_what_was_written(scene, verb):
    path = scene / manifest_of(verb)
    manifest = read_manifest(path, verb)
    assert SETTINGS[verb].items() <= manifest["settings"].items()
    assert manifest["files"]
    assert all((path.parent / name).is_file() for name in manifest["files"])


@pytest.mark.parametrize("verb", SETTINGS)
def test_stats_of_a_run(scene, verb):
    content = json.loads((scene / "stats" / f"{verb}.json").read_text())
    assert content["stage"] == verb
    assert content["wall_s"] > 0
    assert content["peak_memory_bytes"] > 1e7
    assert SETTINGS[verb].items() <= content["settings"].items()


def test_running_again_gives_the_same(work, threads):
    """Also into folders that exist already, and with other numbers of threads than all there are."""
    counts = itertools.cycle((1, 4))
    for verb in ("samples", "environment", "cache", "bake", "fit", "emitters", "refine", "materials", "render"):
        threads(next(counts))
        before = content(work, skip="stats")
        assert call(verb, work) == 0
        after = content(work, skip="stats")
        assert {name for name, data in before.items() if after.get(name) != data} == set(), verb
        assert set(after) == set(before)


@pytest.mark.parametrize("verb", ["environment", "cache", "fit", "emitters"])
def test_bad_pictures(work, refused, verb):
    path = work / "dataset" / "images" / "b.exr"
    image = read_rgb(path)
    for value, word in ((np.nan, "NaN"), (np.inf, "infinite"), (-1.0, "negative")):
        bad = image.copy()
        bad[3, 4, 1] = bad[5, 5] = value
        write_exr(path, {"": bad})
        line = refused(verb)
        assert f"b.exr must hold finite radiance >= 0; 2 pixels are {word}, the first at row 3, column 4" in line
    write_exr(path, {"": image[:-1]})
    assert "b.exr must be 16x12 like its camera; it is 16x11" in refused(verb)
    write_exr(path, {"R": image[..., 0], "Y": image[..., 1]})
    assert "must have the channels R, G, B; G, B not among R, Y" in refused(verb)
    path.unlink()
    assert "missing" in refused(verb)


def test_damaged_files(work, refused):
    for verb, _option, path in (
        ("bake", "--cache", "cache.npz"),
        ("fit", "--cache", "cache.npz"),
        ("render", "--environment", "environment.npz"),
        ("refine", "--emitters", "round-0/emitters.npz"),
        ("materials", "--model", "round-0/model.safetensors"),
        ("materials", "--confidence", "round-0/confidence.npz"),
        ("fit", "--shading", "round-0/shading/train-000/shading.npy"),
    ):
        target = work / path
        whole = target.read_bytes()
        target.write_bytes(whole[: len(whole) // 2])
        line = refused(verb)
        assert target.name in line, verb
        target.unlink()
        assert target.name in refused(verb)
        target.write_bytes(whole)


@pytest.mark.parametrize("verb", SETTINGS)
def test_settings_that_do_not_exist(refused, verb):
    line = refused(verb, settings={"nonsense": 3})
    assert f"unknown key {verb}.nonsense; allowed in {verb}: " in line


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_that_cannot_be_written(work, refused):
    (work / "closed").mkdir(mode=0o500)
    for verb in ("samples", "cache", "bake", "fit", "emitters"):
        assert "cannot be written" in refused(verb, "--out", work / "closed" / "new" / "x.npz")


def test_a_folder_that_is_a_file(work, refused):
    (work / "taken").write_text("mine")
    for verb in ("samples", "cache", "bake", "emitters"):
        assert "taken" in refused(verb, "--out", work / "taken" / "x.npz")
