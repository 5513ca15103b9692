"""USD: read back by ourselves, and what pxr itself says of cameras, lights and materials."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux, UsdShade, UsdUtils

from fipt.errors import FiptError
from fipt.formats.images import write_png
from fipt.scene.environment import EnvironmentMap
from fipt.stages.export.cameras import distinct
from fipt.stages.export.usd import read_usd, write_usd
from tests import assets
from tests.unit.stages.export.test_gltf import same


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usd")
    sky = EnvironmentMap("map", np.ones((4, 8, 3), np.float32))
    # a name that is no USD identifier, and pixels that are not square
    cameras = (assets.camera("1.a-b"), assets.camera("side", 0.7, cx=13.0, cy=14.5, fy=30.0, split="train"))
    asset = assets.room(sky, cameras=cameras, roughness=0.4, metallic=0.8)
    pixels = asset.textures
    write_png(folder / "textures" / "base_color.png", pixels.base_color)
    packed = np.stack([np.zeros_like(pixels.roughness), pixels.roughness, pixels.metallic], axis=-1)
    write_png(folder / "textures" / "metallic_roughness.png", packed)
    write_usd(folder / "scene.usdc", asset, "textures")
    return asset, folder / "scene.usdc"


def test_names_that_lose_characters_stay_distinct(tmp_path):
    cameras = tuple(assets.camera(name) for name in ("000", "100", "a-b", "a_b", "a.b"))
    asset = assets.room(cameras=cameras)
    write_png(tmp_path / "textures" / "base_color.png", asset.textures.base_color)
    packed = np.stack([np.zeros_like(asset.textures.roughness)] * 3, axis=-1)
    write_png(tmp_path / "textures" / "metallic_roughness.png", packed)
    write_usd(tmp_path / "scene.usdc", asset, "textures")
    assert {camera.name for camera in read_usd(tmp_path / "scene.usdc").cameras} == {c.name for c in cameras}
    ids = distinct([f"view_{name}" for name in ("a_b", "a_b", "c", "a_b")])
    assert ids == ["view_a_b", "view_a_b__1", "view_c", "view_a_b__3"]
    assert len(set(distinct(["a_b", "a_b__2", "a_b"]))) == 3


def test_everything_comes_back(written):
    asset, path = written
    read = read_usd(path)
    ordered = {camera.name: camera for camera in read.cameras}
    same(asset, type(read)(*(*vars(read).values(),)[:4], tuple(ordered[c.name] for c in asset.cameras), read.outside))


def test_usd_projects_points_as_our_cameras_do(written):
    """By Gf's own frustum: view and projection matrix."""
    asset, path = written
    stage = Usd.Stage.Open(str(path))
    found = {prim.GetDisplayName(): UsdGeom.Camera(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)}
    points = np.random.default_rng(0).uniform((-1, 0, -2), (1, 2, 0), (50, 3))
    for camera in asset.cameras:
        frustum = found[camera.name].GetCamera(Usd.TimeCode.Default()).frustum
        matrix = np.array(frustum.ComputeViewMatrix()) @ np.array(frustum.ComputeProjectionMatrix())
        clip = np.column_stack([points, np.ones(50)]) @ matrix
        x, y = (clip[:, :2] / clip[:, 3:]).T
        pixel = np.column_stack([(x + 1) / 2 * camera.width, (1 - y) / 2 * camera.height])
        np.testing.assert_allclose(pixel, camera.project(points)[0], atol=1e-3)


def test_lamps_are_mesh_lights_of_their_radiance(written):
    asset, path = written
    stage = Usd.Stage.Open(str(path))
    lights = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.MeshLightAPI)]
    assert [prim.GetName() for prim in lights] == [emitter.name for emitter in asset.emitters]
    for prim, emitter in zip(lights, asset.emitters, strict=True):
        light = UsdLux.LightAPI(prim)
        radiance = light.GetIntensityAttr().Get() * np.array(light.GetColorAttr().Get())
        np.testing.assert_allclose(radiance, emitter.radiance, rtol=1e-6)
        assert not light.GetNormalizeAttr().Get()
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader = UsdShade.Shader(material.GetSurfaceOutput().GetConnectedSources()[0][0].source)
        np.testing.assert_allclose(shader.GetInput("emissiveColor").Get(), emitter.radiance, rtol=1e-6)


def test_the_stage_is_complete(written):
    asset, path = written
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    _, _, missing = UsdUtils.ComputeAllDependencies(str(path))
    assert [name for name in missing if "environment" not in name] == []
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_]).ComputeWorldBound(
        stage.GetDefaultPrim()
    )
    np.testing.assert_allclose(bounds.ComputeAlignedRange().GetMin(), asset.surface.mesh.vertices.min(axis=0))


def test_the_dome_looks_where_our_map_does(written):
    """USD's maps have their centre along z (as OpenEXR says); ours along -z."""
    _, path = written
    stage = Usd.Stage.Open(str(path))
    [dome] = [prim for prim in stage.Traverse() if prim.IsA(UsdLux.DomeLight)]
    turn = np.array(UsdGeom.Xformable(dome).ComputeLocalToWorldTransform(0))[:3, :3]
    np.testing.assert_allclose([0, 0, 1] @ turn, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose([0, 1, 0] @ turn, [0, 1, 0], atol=1e-12)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "bad.usda").write_text("no USD")
    with pytest.raises(FiptError, match="not a readable USD file"):
        read_usd(tmp_path / "bad.usda")
    Usd.Stage.CreateNew(str(tmp_path / "empty.usda")).Save()
    with pytest.raises(FiptError, match="it has no surface"):
        read_usd(tmp_path / "empty.usda")
