"""``fipt emitters`` and ``fipt review``: what is found, and what a person decides."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from fipt.formats.exr import read_rgb
from fipt.scene.change import ShadingChange
from fipt.scene.dataset import Dataset, read_layers
from fipt.scene.emitters import Undecided, read_emitters, write_emitters
from fipt.scene.review import ranges, read_review
from fipt.scene.shading import read_shading
from fipt.stages.emitters import stage as emitters_stage
from fipt.stages.emitters import unseen_guess
from tests import scenes
from tests.fitted import call


def test_the_emitter_is_found_and_seen(scene):
    emitters = read_emitters(scene / "round-0" / "emitters.npz")
    np.testing.assert_array_equal(np.sort(emitters.triangle), scenes.room().triangle)
    np.testing.assert_allclose(emitters.radiance, [scenes.EMITTER_RADIANCE] * 2, rtol=1e-5)
    layers = read_layers(scene / "materials" / "c.exr")
    image, wall = scenes.image(scenes.cameras()[2])
    np.testing.assert_array_equal(layers["hit"], 1)
    np.testing.assert_array_equal(layers["emission_mask"] > 0, wall == 7)
    assert (wall == 7).any()
    assert layers["base_color"].shape == image.shape
    # the lamp's pixels are exact, those at its edge show its share as far as nine rays tell; the rest is lit by it
    render = read_rgb(scene / "render" / "c.exr")
    inside, edge = binary_erosion(wall == 7), binary_dilation(wall == 7) & ~binary_erosion(wall == 7)
    np.testing.assert_allclose(render[inside], image[inside], rtol=1e-5)
    np.testing.assert_allclose(render[edge], image[edge], atol=3)
    assert render[wall != 7].mean() > 0.01


def test_what_a_person_decides_reaches_the_images(work):
    """The only lamp is rejected, and the room is dark; then a wall is accepted, and shines as the pictures show it."""
    emitter = scenes.room().triangle
    decided = {"mesh_triangles": len(scenes.room().mesh.triangles), "reject": [ranges(emitter)]}
    review = work / "emitters_review.yaml"
    before = read_review(review)
    assert (before.triangles, before.emission()) == ((frozenset(emitter.tolist()),), "")
    text = review.read_text().replace("verdict: auto", "verdict: reject")
    review.write_text(text)
    assert json.loads(read_review(review).emission()) == decided
    assert call("emitters", work, "--decisions", json.dumps(decided)) == 0
    assert call("review", work, "--decisions", read_review(review).listing()) == 0
    assert json.loads((work / "emitters" / "emitters.json").read_text())["emitters"] == []
    assert [path.name for path in (work / "emitters").glob("*.png")] == [f"rejected-{emitter.min()}.png"]
    assert read_review(review).emission() == json.dumps(decided, sort_keys=True)
    assert call("render", work) == 0
    wall = scenes.image(scenes.cameras()[2])[1]
    assert read_rgb(work / "render" / "c.exr").max() < 0.01

    assert call("emitters", work, "--decisions", json.dumps(decided | {"accept": ["0-1"]})) == 0
    found = read_emitters(work / "round-0" / "emitters.npz")
    np.testing.assert_array_equal(found.triangle, [0, 1])
    np.testing.assert_allclose(found.radiance, [scenes.COLORS[0]] * 2, rtol=1e-5)
    assert call("render", work) == 0
    assert (read_rgb(work / "render" / "c.exr").max(axis=-1)[wall == 1] > 0.1).all()


def test_what_is_undecided_is_listed_with_an_image(work):
    """A wall that may emit beside the emitter: an entry, a picture, in the list; what emits is none."""
    path, emitter = work / "round-0" / "emitters.npz", scenes.room().triangle
    cost = np.array([20.0], np.float32)
    open_ = Undecided(np.array([0, 1, emitter[0]], np.int32), np.zeros(3, np.int32), cost, cost / 4, cost)
    write_emitters(path, replace(read_emitters(path), undecided=open_), Dataset(work / "dataset").mesh())
    assert call("review", work) == 0
    entries = read_review(work / "emitters_review.yaml").entries
    assert [(entry.question, entry.triangles) for entry in entries] == [
        (None, ranges(emitter)),
        ("emitter or mirror?", "0-1"),
    ]
    assert entries[1].thumbnail == "emitters/undecided-0.png"
    assert (work / entries[1].thumbnail).is_file()
    (asked,) = json.loads((work / "emitters" / "emitters.json").read_text())["undecided"]
    assert asked["thumbnail"] == "undecided-0.png"


def test_the_list_replaces_nothing_but_a_list(work, refused):
    assert "is replaced, but holds" in refused("review", "--out", work / "round-0")
    assert (work / "round-0" / "model.safetensors").is_file()
    assert call("review", work) == 0
    (work / "emitters" / ".stamp").touch()  # as workflow engines leave it
    assert call("review", work) == 0


def test_what_a_person_decides_while_emitters_are_looked_at_stays(work, monkeypatch):
    from fipt.stages.emitters import review as stage

    path, look = work / "emitters_review.yaml", stage.visibilities

    def edited(*args):
        path.write_text(path.read_text().replace("verdict: auto", "verdict: accept"))
        return look(*args)

    monkeypatch.setattr(stage, "visibilities", edited)
    assert call("review", work) == 0
    assert "verdict: accept" in path.read_text()


def test_names_reach_setup_and_list(work, refused):
    triangles = len(scenes.room().mesh.triangles)
    named = {"mesh_triangles": triangles, "names": {"my lamp": ranges(scenes.room().triangle)}}
    assert call("review", work, "--decisions", json.dumps(named)) == 0
    (emitter,) = json.loads((work / "emitters" / "emitters.json").read_text())["emitters"]
    assert (emitter["name"], emitter["share"], emitter["seen_by"]) == ("my lamp", 1.0, ["a", "b"])
    setup, lamps = json.dumps({"emitters": [{"name": "my lamp", "off": True}]}), work / "emitters" / "emitters.json"
    assert call("relight", work, "--setup", setup, "--emitter-names", lamps) == 0
    assert read_rgb(work / "relight" / "night" / "c.exr").max() < 0.01
    assert "names emitter 'my lamp', which is none of 1 emitters; there are emitter-0" in refused(
        "relight", "--setup", setup
    )
    wrong = json.dumps(named | {"mesh_triangles": 3})
    assert f"of a mesh of 3; the mesh has {triangles}" in refused("review", "--decisions", wrong)
    (work / "emitters_review.yaml").write_text("emitters: [")
    assert "emitters_review.yaml is not YAML" in refused("review")


@pytest.mark.parametrize("missing", [False, True])
def test_a_refinement_that_finds_light_missing_asks_for_a_guess(work, monkeypatch, missing):
    told = []
    change = ShadingChange(0.5, 0.05, 0.0, missing)
    monkeypatch.setattr("fipt.scene.change.read_change", lambda folders: change)
    guess = unseen_guess.with_guess
    monkeypatch.setattr(unseen_guess, "with_guess", lambda *args: told.append(args[-1]) or guess(*args))
    assert call("emitters", work, "--cache", work / "cache.npz") == 0
    assert told == [missing]


def test_the_model_of_the_round_before_tells_what_mirrors_show(work, monkeypatch):
    """A triangle that a mirror shows as dark, and one that a person rejects, are bounded; others are not."""
    told, count = [], len(scenes.room().mesh.triangles)

    def shown(mesh, data, shards, model):
        assert len(mesh.triangles) == count
        assert sum(len(shard.samples.views) for shard in shards) == len(data.views("train"))
        assert model.query(mesh.corners[:, 0], None).metallic.shape == (count,)
        return np.where(np.arange(count) == 0, 0.1, np.inf)

    guess = unseen_guess.with_guess
    monkeypatch.setattr("fipt.stages.emitters.mirrors.shown_by_mirrors", shown)
    monkeypatch.setattr(unseen_guess, "with_guess", lambda *args: told.append(args[5]) or guess(*args))
    rejects = json.dumps({"mesh_triangles": count, "reject": ["2-3"]})
    given = ("emitters", work, "--cache", work / "cache.npz", "--decisions", rejects)
    assert call(*given) == 0
    assert call(*given, "--model-before", work / "round-0" / "model.safetensors") == 0
    without, with_model = told
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(without)), [2, 3])
    np.testing.assert_array_equal(with_model[:4], [np.float64(0.1), np.inf, 0, 0])


def test_no_emitter_is_no_error(work, capsys):
    """The run goes on: paths are dark but for the cache, and renders are black."""
    assert call("emitters", work, settings={"decide": "mask", "points": 5, "threshold": 1.0}) == 0
    assert "warning: no emitter found" in capsys.readouterr().err
    assert json.loads((work / "round-0" / "emitters.json").read_text())["emitters"] == []
    for verb in ("refine", "materials", "render", "relight"):
        assert call(verb, work) == 0
    assert not read_layers(work / "materials" / "c.exr")["emission_mask"].any()
    assert read_rgb(work / "render" / "c.exr").max() < 0.01
    assert read_shading(work / "round-1" / "shading" / "train-000")[:][:, 0].mean() > 0
    assert read_rgb(work / "relight" / "night" / "c.exr")[..., 0].max() > 0.05  # the new light


def test_one_line_names_the_largest_undecided_regions():
    rows = [{"area": 0.1 * k, "center": [k, 0.0, 1.0], "ranges": "0-999"} for k in range(1, 6)]
    (said,) = emitters_stage.questions_in_words(rows)
    assert "5 regions: 0.500 m2 near (5.00, 0.00, 1.00); 0.400 m2" in said
    assert "and 2 more" in said
    assert "0-999" not in said
    assert emitters_stage.questions_in_words([]) == []
