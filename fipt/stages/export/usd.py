"""Universal Scene Description: rooms out, and back in.

The surface has a UsdPreviewSurface, each emitter a UsdLux MeshLight (radiance = intensity times colour) and the same
emission as a material for programs that draw it but do not light with it. Texture coordinates start at the lower left.
"""

from pathlib import Path
from typing import Any

import numpy as np

from fipt import __version__
from fipt.errors import FiptError
from fipt.formats.files import atomic, existing_file
from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh
from fipt.scene.cameras import Camera
from fipt.scene.environment import NOTHING
from fipt.scene.mesh import Mesh
from fipt.stages.export.cameras import distinct

_FOCAL = 50.0  # tenths of a scene unit; only its ratio to the aperture means something


def write_usd(path: str | Path, asset: Asset, textures: str) -> None:
    """Write a room.

    Parameters
    ----------
    path
        File, ``*.usdc`` or ``*.usda``.
    asset
        The room.
    textures
        Folder of base_color.png, metallic_roughness.png and, where light comes from outside, environment.exr, relative
        to the file.
    """
    from pxr import Gf, Tf, Usd, UsdGeom, UsdLux

    stage = Usd.Stage.CreateInMemory(".usdc")
    stage.SetMetadata("comment", f"{asset.name}, written by fipt {__version__}")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{Tf.MakeValidIdentifier(asset.name)}").GetPrim()
    root.SetDisplayName(asset.name)
    stage.SetDefaultPrim(root)
    folder = str(root.GetPath())

    _bind(_define_mesh(stage, f"{folder}/surface", asset.surface), _surface_material(stage, folder, textures))
    for emitter in asset.emitters:
        mesh = _define_mesh(stage, f"{folder}/emitters/{emitter.name}", emitter)
        strength = float(emitter.radiance.max())
        color = emitter.radiance / strength if strength > 0 else np.ones(3)
        UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
        light = UsdLux.LightAPI(mesh.GetPrim())
        light.CreateIntensityAttr(strength)
        light.CreateColorAttr(Gf.Vec3f(*map(float, color)))
        light.CreateNormalizeAttr(False)
        light.CreateMaterialSyncModeAttr(UsdLux.Tokens.noMaterialResponse)
        _bind(mesh, _emitter_material(stage, f"{folder}/materials/{emitter.name}", emitter))
    names = distinct([Tf.MakeValidIdentifier(f"view_{camera.name}") for camera in asset.cameras])
    for camera, name in zip(asset.cameras, names, strict=True):
        _define_camera(stage, f"{folder}/cameras/{name}", camera)
    if asset.outside.emits:
        dome = UsdLux.DomeLight.Define(stage, f"{folder}/outside")
        dome.CreateTextureFileAttr(f"./{textures}/environment.exr")
        dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
        dome.AddRotateYOp().Set(180.0)  # its maps have their centre at +z, ours at -z
    with atomic(path) as temporary:
        stage.GetRootLayer().Export(str(temporary))


def _define_mesh(stage: Any, path: str, piece: TexturedMesh) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    vertices, triangles = piece.mesh.vertices, piece.mesh.triangles
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(triangles.ravel(), np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(piece.two_sided)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([vertices.min(axis=0), vertices.max(axis=0)])))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    upward = np.column_stack([piece.uv[:, 0], 1 - piece.uv[:, 1]]).astype(np.float32)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(upward)))
    return mesh


def _bind(mesh: Any, material: Any) -> None:
    from pxr import UsdShade

    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _surface_material(stage: Any, folder: str, textures: str) -> Any:
    from pxr import Sdf, UsdShade

    path = f"{folder}/materials/surface"
    material, shader = _preview_surface(stage, path)
    reader = UsdShade.Shader.Define(stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    place = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    for name, space, channels in (
        ("base_color", "sRGB", {"diffuseColor": "rgb"}),
        ("metallic_roughness", "raw", {"roughness": "g", "metallic": "b"}),
    ):
        texture = UsdShade.Shader.Define(stage, f"{path}/{name}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{textures}/{name}.png")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("clamp")
        texture.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("clamp")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(place)
        for key, channel in channels.items():
            kind = Sdf.ValueTypeNames.Float3 if channel == "rgb" else Sdf.ValueTypeNames.Float
            wanted = Sdf.ValueTypeNames.Color3f if channel == "rgb" else Sdf.ValueTypeNames.Float
            shader.CreateInput(key, wanted).ConnectToSource(texture.CreateOutput(channel, kind))
    return material


def _emitter_material(stage: Any, path: str, emitter: TexturedMesh) -> Any:
    from pxr import Gf, Sdf

    material, shader = _preview_surface(stage, path)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0, 0, 0))
    shader.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*map(float, emitter.radiance)))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    return material


def _preview_surface(stage: Any, path: str) -> tuple[Any, Any]:
    """A material and its shader."""
    from pxr import UsdShade

    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/shader")
    shader.CreateIdAttr("UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material, shader


def _define_camera(stage: Any, path: str, camera: Camera) -> None:
    from pxr import Gf, UsdGeom

    prim = UsdGeom.Camera.Define(stage, path)
    prim.AddTransformOp().Set(Gf.Matrix4d(*camera.world_from_camera.T.ravel().tolist()))  # rows times matrix
    horizontal, vertical = _FOCAL * camera.width / camera.fx, _FOCAL * camera.height / camera.fy
    prim.CreateFocalLengthAttr(_FOCAL)
    prim.CreateHorizontalApertureAttr(horizontal)
    prim.CreateVerticalApertureAttr(vertical)
    prim.CreateHorizontalApertureOffsetAttr(horizontal * (0.5 - camera.cx / camera.width))
    prim.CreateVerticalApertureOffsetAttr(vertical * (camera.cy / camera.height - 0.5))
    prim.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000.0))
    prim.GetPrim().SetDisplayName(camera.name)
    facts = {"split": camera.split, "width": camera.width, "height": camera.height}
    prim.GetPrim().SetCustomDataByKey("fipt", facts)


# --- reading --------------------------------------------------------------------------------------


def read_usd(path: str | Path) -> Asset:
    """Read a room that `write_usd` wrote.

    Raises
    ------
    FiptError
        If the file is missing, damaged or holds something else.
    """
    from pxr import Tf, Usd, UsdGeom, UsdLux

    existing_file(path, "a USD file")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise FiptError(f"{path} is not a readable USD file ({error})", "export it again") from error
    surface, emitters, cameras = None, [], []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            if prim.HasAPI(UsdLux.MeshLightAPI):
                light = UsdLux.LightAPI(prim)
                color = np.array(light.GetColorAttr().Get(), np.float32)
                emitters.append(_piece(mesh, light.GetIntensityAttr().Get() * color))
            else:
                surface = _piece(mesh, np.zeros(3, np.float32))
        elif prim.IsA(UsdGeom.Camera):
            cameras.append(_camera(UsdGeom.Camera(prim)))
    if surface is None:
        raise FiptError(f"{path} is not a room that fipt exported (it has no surface)", "export it again")
    root = stage.GetDefaultPrim()
    textures = _textures(stage, f"{root.GetPath()}/materials/surface")
    return Asset(root.GetDisplayName() or root.GetName(), surface, tuple(emitters), textures, tuple(cameras), NOTHING)


def _piece(mesh: Any, radiance: np.ndarray) -> TexturedMesh:
    from pxr import UsdGeom

    if set(mesh.GetFaceVertexCountsAttr().Get()) != {3}:
        raise FiptError(f"{mesh.GetPath()} must consist of triangles", "export it again")
    vertices = np.array(mesh.GetPointsAttr().Get(), np.float32)
    triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get(), np.int32).reshape(-1, 3)
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get(), np.float32)
    uv = np.column_stack([st[:, 0], 1 - st[:, 1]])
    both = mesh.GetDoubleSidedAttr().Get()
    return TexturedMesh(mesh.GetPrim().GetName(), Mesh(vertices, triangles), uv, radiance, both)


def _textures(stage: Any, material: str) -> MaterialTextures:
    from PIL import Image
    from pxr import UsdShade

    def pixels(name: str) -> np.ndarray:
        shader = UsdShade.Shader(stage.GetPrimAtPath(f"{material}/{name}"))
        with Image.open(shader.GetInput("file").Get().resolvedPath) as image:
            return np.array(image.convert("RGB"))

    packed = pixels("metallic_roughness")
    return MaterialTextures(pixels("base_color"), packed[..., 1], packed[..., 2])


def _camera(camera: Any) -> Camera:
    from pxr import UsdGeom

    prim = camera.GetPrim()
    facts = prim.GetCustomDataByKey("fipt")
    width, height, focal = facts["width"], facts["height"], camera.GetFocalLengthAttr().Get()
    horizontal, vertical = camera.GetHorizontalApertureAttr().Get(), camera.GetVerticalApertureAttr().Get()
    right, up = camera.GetHorizontalApertureOffsetAttr().Get(), camera.GetVerticalApertureOffsetAttr().Get()
    pose = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0)).T
    return Camera(
        name=prim.GetDisplayName(),
        split=facts["split"],
        width=width,
        height=height,
        fx=focal * width / horizontal,
        fy=focal * height / vertical,
        cx=width * (0.5 - right / horizontal),
        cy=height * (0.5 + up / vertical),
        world_from_camera=pose,
    )
