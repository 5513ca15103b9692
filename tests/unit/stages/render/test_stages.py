"""``fipt relight`` and ``fipt olat``: setups, and one light at a time."""

import json

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.images import srgb_encode
from fipt.scene.dataset import read_layers
from tests import scenes
from tests.fitted import call

MISSING = 1
"""The wall +x, which the room of `opened` lacks."""


def test_the_new_light_is_red_and_the_old_one_off(scene):
    night = read_rgb(scene / "relight" / "night" / "c.exr")
    assert night[..., 1:].max() < 1e-3  # the denoiser is never quite black
    assert night[..., 0].max() > 0.05
    _, _wall = scenes.image(scenes.cameras()[2])
    emitter = read_layers(scene / "materials" / "c.exr")["emission_mask"] > 0
    assert night[emitter].max() < 1.0


def test_the_only_emitter_alone_is_the_room_as_it_is(scene, tmp_path):
    layers = read_layers(scene / "olat" / "c.exr")
    assert set(layers) == {"emitter-0"}
    assert call("relight", scene, "--setup", "{}", "--out", tmp_path, "--manifest", tmp_path / "m.json") == 0
    np.testing.assert_array_equal(layers["emitter-0"], read_rgb(tmp_path / "c.exr"))


def test_setups_change_the_light_from_outside(opened, tmp_path):
    _, wall = scenes.image(scenes.cameras()[2])
    outside = binary_erosion(wall == MISSING + 1)
    write_exr(tmp_path / "sky.exr", {"": np.broadcast_to(np.float32([3, 0, 0]), (4, 8, 3))})
    for edit, expected in (
        ({"scale": 0.5}, 0.5 * scenes.COLORS[MISSING]),
        ({"radiance": [0, 0, 4]}, [0, 0, 4]),
        ({"file": str(tmp_path / "sky.exr"), "scale": 2}, [6, 0, 0]),
    ):
        setup = json.dumps({"emitters": [{"scale": 0}], "environment": edit})
        assert call("relight", opened, "--setup", setup, "--out", opened / "relight" / "other") == 0
        image = read_rgb(opened / "relight" / "other" / "c.exr")
        shown = image[outside]
        np.testing.assert_allclose(shown, np.broadcast_to(expected, shown.shape), rtol=1e-3, atol=1e-5)
        inside = image[wall == 4].mean(axis=0)
        assert inside.argmax() == np.argmax(expected)
        assert inside.max() > 2e-3


def test_emitters_and_outside_alone_add_up_to_any_mix_of_them(opened, tmp_path):
    """Within 40 dB as displayed, denoised, though the denoiser is not linear."""
    many = {"spp": 1024, "max_depth": 3}
    assert call("olat", opened, "--out", tmp_path, "--manifest", tmp_path / "m.json", settings=many) == 0
    layers = read_layers(tmp_path / "c.exr")
    assert set(layers) == {"emitter-0", "outside"}
    tint = np.array([0.5, 1.0, 2.0])
    radiance = (scenes.EMITTER_RADIANCE * tint).tolist()
    for setup, gains in (
        ({}, (1, 1)),
        ({"emitters": [{"radiance": radiance}], "environment": {"scale": 3}}, (tint, 3)),
        ({"emitters": [{"scale": 0.2}], "environment": {"scale": 2}}, (0.2, 2)),
    ):
        relit = ("--setup", json.dumps(setup), "--out", tmp_path / "relit", "--manifest", tmp_path / "r.json")
        assert call("relight", opened, *relit, settings=many) == 0
        direct = read_rgb(tmp_path / "relit" / "c.exr")
        mixed = gains[0] * layers["emitter-0"] + gains[1] * layers["outside"]
        shown = [srgb_encode(np.clip(2 * image, 0, 1)) for image in (mixed, direct)]
        assert 0.1 < shown[1].mean() < 0.9
        assert -10 * np.log10(((shown[0] - shown[1]) ** 2).mean()) > 40, setup


def test_a_light_setup_that_names_no_emitter(refused):
    assert "names emitter 7, which is none of 1 emitters; indices are 0 to 0" in refused(
        "relight", "--setup", '{"emitters": [{"index": 7, "scale": 0}]}'
    )
    assert "unknown key setup.lamps" in refused("relight", "--setup", '{"lamps": []}')


def test_a_setup_whose_objects_cannot_be_used(refused, tmp_path):
    def setup(**keys):
        return ("--setup", json.dumps(keys))

    (tmp_path / "a.ply").write_text("nothing")
    thing = {"file": str(tmp_path / "a.ply"), "position": [2, 1, 2]}
    assert "a.ply is not a readable mesh" in refused("relight", *setup(objects=[thing]))
    assert "an object's file is missing" in refused("relight", *setup(objects=[thing | {"file": "none.glb"}]))
    assert "names segment 77, which does not exist; there are 0" in refused("relight", *setup(remove=[{"segment": 77}]))
    light = {"shape": "sphere", "center": [2, 1, 2], "radiance": [1, -1, 1]}
    assert "setup.lights.0.radiance.1" in refused("relight", *setup(lights=[light]))


def test_a_setup_file_puts_an_object_in_and_takes_a_wall_away(scene, tmp_path):
    """The view sees a red cube before it; and where the far wall was, nothing but black."""
    setup = tmp_path / "setup.yaml"
    setup.write_text(
        "objects:\n  - {shape: cube, size: 0.5, position: [2.0, 2.0, 2.7], base_color: [0.8, 0.02, 0.02]}\n"
        "remove:\n  - {box: {center: [2, 1.5, 5], size: [4.1, 3.1, 0.1]}}\n"
    )
    out = ("--setup", setup, "--out", tmp_path / "out", "--manifest", tmp_path / "m.json")
    assert call("relight", scene, *out) == 0
    image, plain = read_rgb(tmp_path / "out" / "c.exr"), read_rgb(scene / "render" / "c.exr")
    _, wall = scenes.image(scenes.cameras()[2])
    assert (wall == 6).sum() > 10
    red = image[..., 0] > 3 * image[..., 1]
    assert red.sum() > 3
    gone = (wall == 6) & ~red
    inner = binary_erosion(gone)
    assert plain[inner].mean() > 0.01
    assert image[inner].max() < 1e-3


@pytest.mark.parametrize("verb", ["render", "relight", "olat"])
def test_a_view_that_the_dataset_lacks(verb, scene, tmp_path, capsys):
    made = ("--views", "nowhere", "--out", tmp_path / "out", "--manifest", tmp_path / "out.manifest.json")
    assert call(verb, scene, *made) == 2
    assert "view nowhere is not among the accepted views" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
