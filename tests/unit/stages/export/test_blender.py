"""The Blender script in Blender itself, where FIPT_BLENDER names a Python that has the package ``bpy``."""

import os
import runpy
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.formats.exr import read_rgb, write_exr
from fipt.scene.cameras import write_transforms
from fipt.scene.environment import EnvironmentMap, constant, texel_directions
from fipt.stages.export.blender import write_blender
from fipt.stages.export.gltf import write_glb
from tests import assets, scenes


def drawn(folder, asset, sky):
    """The room as Blender draws it for its only camera."""
    python = os.environ.get("FIPT_BLENDER")
    if not python:
        pytest.skip("needs FIPT_BLENDER: a Python with `pip install bpy`")
    write_glb(folder / "scene.glb", asset)
    write_exr(folder / "textures" / "environment.exr", {"": sky.radiance})
    write_transforms(folder / "cameras" / "transforms.json", asset.cameras)
    write_blender(folder / "blender.py", asset)
    command = [python, str(folder / "blender.py"), "--", asset.cameras[0].name, str(folder / "image.exr")]
    subprocess.run(command, check=True, capture_output=True)
    return read_rgb(folder / "image.exr")


@pytest.mark.parametrize("fit", ["HORIZONTAL", "VERTICAL", "AUTO"])
@pytest.mark.parametrize("fy", [20.0, 26.0, 50.0])
def test_pixels_that_are_not_square(tmp_path, monkeypatch, fit, fy):
    """What the script sets, by Blender's definition: the lens is that of the longer side, or of the side it is told."""
    camera = assets.camera("side", 0.4, width=40, height=30, cx=18.0, cy=16.5, fy=fy)
    write_blender(tmp_path / "blender.py", assets.room())
    write_transforms(tmp_path / "cameras" / "transforms.json", [camera])

    class Object(dict):
        data = SimpleNamespace(sensor_fit=fit)

    scene, found = SimpleNamespace(render=SimpleNamespace()), Object()
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(data=SimpleNamespace(objects={"side": found})))
    runpy.run_path(str(tmp_path / "blender.py"))["_cameras"](scene)
    made = scene.render
    assert min(made.pixel_aspect_x, made.pixel_aspect_y) == 1
    size = np.array([made.resolution_x * made.pixel_aspect_x, made.resolution_y * made.pixel_aspect_y])
    side = {"HORIZONTAL": size[0], "VERTICAL": size[1], "AUTO": size.max()}[fit]
    # where the image's edges lie at distance 1 before the camera; glTF gives the height
    middle = side * np.array([found.data.shift_x, found.data.shift_y])
    edges = (middle + np.array([[-0.5], [0.5]]) * size) * (camera.height / camera.fy / size[1])
    corners = camera.directions(np.array([0, 40]), np.array([30, 0]))
    expected = corners @ camera.world_from_camera[:3, :3]
    np.testing.assert_allclose(edges, expected[:, :2] / -expected[:, 2:], atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("fy", [26.0, 40.0])
def test_blender_sees_the_room_and_the_outside(tmp_path, fy):
    sky = EnvironmentMap("map", (1 + 0.5 * texel_directions(32, 64)).reshape(32, 64, 3).astype(np.float32))
    camera = assets.camera("side", 0.4, width=40, height=30, cx=18.0, cy=16.5, fy=fy)
    image = drawn(tmp_path, assets.room(sky, walls=4, cameras=(camera,)), sky)
    rows, columns = np.indices((30, 40)).reshape(2, -1)
    seen = 1 + 0.5 * camera.directions(columns + 0.5, rows + 0.5).reshape(30, 40, 3)
    np.testing.assert_allclose(image[11:16, 12:24], seen[11:16, 12:24], atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("facing", "two_sided", "gain"), [(1, False, 1), (-1, False, 0), (-1, True, 1)])
def test_emitters_shine_from_their_sides_in_blender(tmp_path, facing, two_sided, gain):
    """A sheet across the room that faces the camera, or away from it. Blender's black reflects a little."""
    camera, room = assets.camera("side", 0.0, width=8, height=6), assets.room(walls=4)
    sheet = scenes.quad((-9, -9, -1.5), (18 * facing, 0, 0), (0, 18, 0))
    sheet = type(sheet)(sheet.vertices + np.float32([9 - 9 * facing, 0, 0]), sheet.triangles)
    lamp = replace(room.emitters[0], mesh=sheet, two_sided=two_sided)
    night = constant((0, 0, 0), "y")
    image = drawn(tmp_path, replace(room, emitters=(lamp,), cameras=(camera,)), night)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), gain * lamp.radiance, rtol=0.1, atol=0.01)
