"""glTF: read back by ourselves, by trimesh, and judged by the Khronos validator where it is installed."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fipt.errors import FiptError
from fipt.scene.asset import intensity
from fipt.stages.export.gltf import read_glb, write_glb
from tests import assets, scenes


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("gltf") / "scene.glb"
    asset = assets.room(roughness=0.4, metallic=0.8)
    write_glb(path, asset, point_size=0.5)
    return asset, path


def document(path):
    content = path.read_bytes()
    return json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])


def same(asset, read):
    assert (read.name, len(read.emitters)) == (asset.name, len(asset.emitters))
    np.testing.assert_allclose(read.surface.uv, asset.surface.uv, atol=1e-6)
    for piece, other in zip((asset.surface, *asset.emitters), (read.surface, *read.emitters), strict=True):
        assert (piece.name, piece.two_sided) == (other.name, other.two_sided)
        np.testing.assert_array_equal(piece.mesh.vertices, other.mesh.vertices)
        np.testing.assert_array_equal(piece.mesh.triangles, other.mesh.triangles)
        np.testing.assert_allclose(piece.radiance, other.radiance, rtol=1e-6)
    for key in ("base_color", "roughness", "metallic"):
        np.testing.assert_array_equal(getattr(asset.textures, key), getattr(read.textures, key))
    for camera, other in zip(asset.cameras, read.cameras, strict=True):
        np.testing.assert_allclose(camera.world_from_camera, other.world_from_camera, atol=1e-6)
        assert (other.name, other.split) == (camera.name, camera.split)
        for key in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(other, key) == pytest.approx(getattr(camera, key), rel=1e-6), key


def test_everything_comes_back(written):
    asset, path = written
    same(asset, read_glb(path))


def test_another_reader_finds_the_same_surface(written):
    """trimesh: points, triangles, textures with the right channels, and texture coordinates at the right corner."""
    asset, path = written
    scene = trimesh.load(path, process=False)
    mesh = scene.geometry["surface"]
    np.testing.assert_array_equal(mesh.vertices.astype(np.float32), asset.surface.mesh.vertices)
    np.testing.assert_array_equal(mesh.faces, asset.surface.mesh.triangles)
    material = mesh.visual.material
    np.testing.assert_array_equal(np.array(material.baseColorTexture)[..., :3], asset.textures.base_color)
    packed = np.array(material.metallicRoughnessTexture)
    np.testing.assert_array_equal(packed[..., 1], asset.textures.roughness)
    np.testing.assert_array_equal(packed[..., 2], asset.textures.metallic)
    assert material.doubleSided
    # trimesh has v pointing up: the first corner of the first wall shows the texture's upper left texel
    color = material.to_color(np.add(mesh.visual.uv[:1], [0.01, -0.01]))
    np.testing.assert_array_equal(np.asarray(color).ravel()[:3], asset.textures.base_color[0, 0])


def test_lamps_are_black_and_shine(written):
    asset, path = written
    materials = {material["name"]: material for material in document(path)["materials"]}
    for emitter in asset.emitters:
        material = materials[emitter.name]
        strength = material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        np.testing.assert_allclose(strength * np.array(material["emissiveFactor"]), emitter.radiance, rtol=1e-6)
        assert max(material["emissiveFactor"]) <= 1
        assert material["pbrMetallicRoughness"]["baseColorFactor"] == [0, 0, 0, 1]


def test_small_lamps_are_point_lights_too(written):
    asset, path = written
    [light] = document(path)["extensions"]["KHR_lights_punctual"]["lights"]
    # a cube of side 0.1: a convex body shows a quarter of its area
    expected = 0.25 * 6 * 0.01 * asset.emitters[1].radiance
    np.testing.assert_allclose(light["intensity"] * np.array(light["color"]), expected, rtol=1e-5)
    node = next(node for node in document(path)["nodes"] if node["name"] == "emitter_1_point")
    np.testing.assert_allclose(node["translation"], [1.25, 0.65, 0.05], atol=1e-6)


def test_the_intensity_of_a_sheet_is_its_mean_over_all_directions():
    emitter = assets.room().emitters[0]
    directions = np.random.default_rng(0).normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    area = 1.2 * 1.2
    mean = area * np.abs(directions[:, 1]).mean()
    np.testing.assert_allclose(intensity(emitter), mean * emitter.radiance, rtol=0.01)
    np.testing.assert_allclose(intensity(replace(emitter, two_sided=False)), mean / 2 * emitter.radiance, rtol=0.01)
    assert not emitter.closed


def test_a_room_without_lamps_and_cameras(tmp_path):
    bare = assets.room(cameras=())
    bare = type(bare)(bare.name, bare.surface, (), bare.textures, (), bare.outside)
    write_glb(tmp_path / "bare.glb", bare)
    same(bare, read_glb(tmp_path / "bare.glb"))
    assert "extensionsUsed" not in document(tmp_path / "bare.glb")


def test_a_lamp_that_is_off_has_no_emission(tmp_path):
    asset = assets.room()
    off = type(asset.emitters[0])(
        "emitter_0", scenes.quad((0, 1, 0), (1, 0, 0), (0, 0, 1)), np.zeros((4, 2)), np.zeros(3), two_sided=False
    )
    asset = type(asset)("x", asset.surface, (off,), asset.textures, (), asset.outside)
    write_glb(tmp_path / "off.glb", asset)
    assert not read_glb(tmp_path / "off.glb").emitters[0].radiance.any()
    assert not read_glb(tmp_path / "off.glb").emitters[0].two_sided


@pytest.mark.parametrize("damage", [lambda data: data[:-5], lambda data: b"glTF" + data[9:], lambda data: b""])
def test_damaged_files_are_refused(written, tmp_path, damage):
    path = tmp_path / "damaged.glb"
    path.write_bytes(damage(written[1].read_bytes()))
    with pytest.raises(FiptError, match="is not a room that fipt exported"):
        read_glb(path)


_VALIDATE = """
const validator = require('gltf-validator');
const content = require('fs').readFileSync(process.argv[2]);
validator.validateBytes(new Uint8Array(content)).then(report => console.log(JSON.stringify(report.issues)));
"""


def test_the_khronos_validator_finds_nothing(written, tmp_path):
    """Where FIPT_GLTF_VALIDATOR names a folder in which ``npm install gltf-validator`` ran."""
    folder, node = os.environ.get("FIPT_GLTF_VALIDATOR"), shutil.which("node")
    if not folder or not node:
        pytest.skip("needs node, and FIPT_GLTF_VALIDATOR: a folder in which `npm install gltf-validator` ran")
    script = tmp_path / "validate.js"
    script.write_text(_VALIDATE)
    environment = os.environ | {"NODE_PATH": str(Path(folder, "node_modules"))}
    done = subprocess.run(
        [node, str(script), str(written[1])], env=environment, capture_output=True, text=True, check=True
    )
    issues = json.loads(done.stdout)
    # an atlas has the size that it needs: what only old programs mind
    other = [message for message in issues["messages"] if message["code"] != "IMAGE_NPOT_DIMENSIONS"]
    assert (issues["numErrors"], issues["numWarnings"], other) == (0, 0, [])
