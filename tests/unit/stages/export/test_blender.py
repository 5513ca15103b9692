"""The Blender script in Blender itself, where FIPT_BLENDER names a Python that has the package ``bpy``."""

import os
import subprocess

import numpy as np
import pytest

from fipt.formats.exr import read_rgb, write_exr
from fipt.scene.cameras import write_transforms
from fipt.scene.environment import EnvironmentMap, texel_directions
from fipt.stages.export.blender import write_blender
from fipt.stages.export.gltf import write_glb
from tests import assets


@pytest.mark.slow
def test_blender_sees_the_room_and_the_outside(tmp_path):
    python = os.environ.get("FIPT_BLENDER")
    if not python:
        pytest.skip("needs FIPT_BLENDER: a Python with `pip install bpy`")
    sky = EnvironmentMap("map", (1 + 0.5 * texel_directions(32, 64)).reshape(32, 64, 3).astype(np.float32))
    camera = assets.camera("side", 0.4, width=40, height=30, cx=18.0, cy=16.5)
    asset = assets.room(sky, walls=4, cameras=(camera,))
    write_glb(tmp_path / "scene.glb", asset)
    write_exr(tmp_path / "textures" / "environment.exr", {"": sky.radiance})
    write_transforms(tmp_path / "cameras" / "transforms.json", [camera])
    write_blender(tmp_path / "blender.py", asset)
    out = tmp_path / "image.exr"
    subprocess.run([python, str(tmp_path / "blender.py"), "--", "side", str(out)], check=True, capture_output=True)
    rows, columns = np.indices((30, 40)).reshape(2, -1)
    seen = 1 + 0.5 * camera.directions(columns + 0.5, rows + 0.5).reshape(30, 40, 3)
    np.testing.assert_allclose(read_rgb(out)[11:16, 12:24], seen[11:16, 12:24], atol=0.02)
