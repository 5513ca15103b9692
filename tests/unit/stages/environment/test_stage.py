"""``fipt environment``: light from outside, and what it lights."""

import json

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.exr import read_rgb, write_exr
from fipt.scene.environment import EnvironmentMap, read_environment
from fipt.scene.shading import read_shading
from fipt.scene.sun import split
from tests import scenes
from tests.fitted import SETTINGS, call

MISSING = 1
"""The wall +x, which the room of `opened` lacks."""


def test_a_closed_room_has_no_light_from_outside(scene):
    assert json.loads((scene / "stats" / "environment.json").read_text())["mode"] == "none"
    assert load_npz(scene / "environment.npz")["radiance"].shape == (1, 1, 3)


def test_light_from_outside_is_found_and_lights_the_room(opened, tmp_path):
    found = read_environment(opened / "environment.npz")
    assert found.mode == "map"
    np.testing.assert_allclose(found.radiance, np.broadcast_to(scenes.COLORS[MISSING], (32, 64, 3)), rtol=1e-4)
    _, wall = scenes.image(scenes.cameras()[2])
    outside = binary_erosion(wall == MISSING + 1)
    assert outside.sum() > 20
    shown = read_rgb(opened / "render" / "c.exr")[outside]
    np.testing.assert_allclose(shown, np.broadcast_to(scenes.COLORS[MISSING], shown.shape), rtol=1e-3)
    # the opening lights as the wall did; without the background it is dark (denoising is not linear)
    noisy = SETTINGS["bake"] | {"denoise": False}
    assert call("bake", opened, "--out", tmp_path / "lit", settings=noisy) == 0
    assert call("bake", opened, "--environment", None, "--out", tmp_path / "dark", settings=noisy) == 0
    lit, dark = (read_shading(tmp_path / name)[:][:, 0].mean(axis=0) for name in ("lit", "dark"))
    gained = lit - dark
    assert gained[1] > 0.05
    np.testing.assert_allclose(gained / gained[1], scenes.COLORS[MISSING] / 0.5, atol=0.02)  # green


def test_a_sun_that_is_found_stands_in_the_map(opened, tmp_path, monkeypatch):
    from fipt.stages.environment.from_room import FoundOutside
    from fipt.stages.environment.sun import FoundSun

    toward = np.array([0.8, 0.5, 0.2]) / np.linalg.norm([0.8, 0.5, 0.2])
    sun = FoundSun(toward, np.array([90.0, 70.0, 50.0]), np.radians(0.27), 40.0)
    sky = EnvironmentMap("map", np.ones((32, 64, 3), np.float32))
    monkeypatch.setattr(
        "fipt.stages.environment.fit.outside_from_room", lambda *_: FoundOutside(sky, sun, {"sun": sun.figures})
    )
    out, stats = tmp_path / "sunny.npz", tmp_path / "stats.json"
    assert call("environment", opened, "--out", out, "--stats", stats) == 0
    found = read_environment(out)
    assert found.radiance.shape == (512, 1024, 3)
    np.testing.assert_allclose(split(found)[1].irradiance.sum(axis=0), sun.irradiance, rtol=0.02)
    assert found.lookup(toward[None]).min() > 1e5
    assert json.loads(stats.read_text())["sun"]["direction"] == pytest.approx(toward)


def test_bad_environments(work, refused, tmp_path):
    out = ("--out", work / "new.npz")

    def said(**settings):
        return refused("environment", *out, settings=settings)

    assert "environment.file is missing; mode: given needs file" in said(mode="given")
    assert "environment.file is only for mode given; mode is auto" in said(file="sky.exr")
    assert "environment.radiance is only for mode constant; mode is map" in said(mode="map", radiance=[1, 1, 1])
    assert "environment.mode constant needs training pixels that see no surface" in said(mode="constant")
    assert "environment.mode: input should be" in said(mode="sky")
    assert "sky.exr" in said(mode="given", file=str(tmp_path / "sky.exr"))
    write_exr(tmp_path / "sky.exr", {"": np.full((4, 8, 3), np.nan)})
    assert "32 texels are NaN" in said(mode="given", file=str(tmp_path / "sky.exr"))
    assert "32 texels are NaN" in refused(
        "relight", "--setup", json.dumps({"environment": {"file": str(tmp_path / "sky.exr")}})
    )
    save_npz(work / "flat.npz", mode=np.array("map"), radiance=np.ones((4, 8)), up=np.array("y"), rotation=0.0)
    for verb in ("bake", "fit", "refine", "render"):
        assert "flat.npz: the array radiance must be" in refused(verb, "--environment", work / "flat.npz")
