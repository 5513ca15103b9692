"""glTF 2.0 in one binary file (.glb): rooms out, and back in.

Written and read is what `fipt.scene.asset` holds: one mesh with metallic-roughness textures, one mesh an emitter with
an emission (KHR_materials_emissive_strength), a camera a view, and on request point lights in the place of small
emitters (KHR_lights_punctual). There are no normals in the file: by the specification, surfaces without them are flat.
"""

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np

from fipt import __version__
from fipt.errors import FiptError
from fipt.formats.files import atomic, existing_file
from fipt.formats.glb import chunks, packed
from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh, intensity
from fipt.scene.cameras import Camera
from fipt.scene.environment import NOTHING
from fipt.scene.mesh import Mesh

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_LINEAR_MIPMAP, _LINEAR, _CLAMP = 9987, 9729, 33071
_EMISSION, _PUNCTUAL = "KHR_materials_emissive_strength", "KHR_lights_punctual"
_ENGINE_NEAR = 0.01  # metres: nearer surface is cut off by rasterisers


def png(pixels: np.ndarray) -> bytes:
    """Encode (h, w[, 3]) uint8 as PNG."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def write_glb(path: str | Path, asset: Asset, point_size: float = 0.0) -> None:
    """Write a room.

    Parameters
    ----------
    path
        File, ``*.glb``.
    asset
        The room; light from outside has no place in glTF and is left out.
    point_size
        Emitters of less than this extent, metres, become point lights as well, for programs without area lights.
    """
    binary = _Binary()
    document = _document(asset, binary)
    pieces = [asset.surface, *asset.emitters]
    document["materials"] = [_surface_material(), *map(_emitter_material, asset.emitters)]
    document["meshes"] = [_mesh(piece, number, binary) for number, piece in enumerate(pieces)]
    nodes = [{"name": piece.name, "mesh": number} for number, piece in enumerate(pieces)]
    nodes += [_camera_node(camera, number) for number, camera in enumerate(asset.cameras)]
    small = [
        emitter
        for emitter in asset.emitters
        if emitter.radiance.any() and np.ptp(emitter.mesh.vertices, 0).max() < point_size
    ]
    if small:
        document["extensions"] = {_PUNCTUAL: {"lights": [_point_light(emitter) for emitter in small]}}
        nodes += [_light_node(emitter, number) for number, emitter in enumerate(small)]
    document["nodes"] = [*nodes, {"name": asset.name, "children": list(range(len(nodes)))}]
    document["scenes"] = [{"name": asset.name, "nodes": [len(nodes)]}]
    if asset.cameras:
        document["cameras"] = [_camera(camera) for camera in asset.cameras]
    used = [_EMISSION] * any(emitter.radiance.any() for emitter in asset.emitters) + [_PUNCTUAL] * bool(small)
    if used:
        document["extensionsUsed"] = used
    document |= {"accessors": binary.accessors, "bufferViews": binary.views}
    document["buffers"] = [{"byteLength": len(binary.data)}]
    content = packed(document, binary.data)
    with atomic(path) as temporary:
        temporary.write_bytes(content)


class _Binary:
    """The binary chunk so far, and the views and accessors into it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, content: bytes, **keys: Any) -> int:
        """Append bytes; return the number of their view."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content), **keys})
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.views) - 1

    def vectors(self, array: np.ndarray) -> int:
        """Append (N, 2) or (N, 3) float32 vertex data; return its accessor."""
        array = np.ascontiguousarray(array, "<f4")
        view = self.view(array.tobytes(), target=_VERTICES)
        bounds = {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        kind = f"VEC{array.shape[1]}"
        self.accessors.append(
            {"bufferView": view, "componentType": _FLOAT, "count": len(array), "type": kind, **bounds}
        )
        return len(self.accessors) - 1

    def indices(self, triangles: np.ndarray) -> int:
        """Append (T, 3) vertex numbers; return their accessor."""
        array = np.ascontiguousarray(triangles, "<u4")
        view = self.view(array.tobytes(), target=_INDICES)
        self.accessors.append({"bufferView": view, "componentType": _UINT, "count": array.size, "type": "SCALAR"})
        return len(self.accessors) - 1


def _document(asset: Asset, binary: _Binary) -> dict[str, Any]:
    """The file's head, with the textures."""
    textures = asset.textures
    mixed = np.stack([np.zeros_like(textures.roughness), textures.roughness, textures.metallic], axis=-1)
    images = {"base_color": textures.base_color, "metallic_roughness": mixed}
    return {
        "asset": {"version": "2.0", "generator": f"fipt {__version__}", "extras": {"scene": asset.name}},
        "scene": 0,
        "samplers": [{"magFilter": _LINEAR, "minFilter": _LINEAR_MIPMAP, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "images": [
            {"name": name, "mimeType": "image/png", "bufferView": binary.view(png(pixels))}
            for name, pixels in images.items()
        ],
        "textures": [{"sampler": 0, "source": number, "name": name} for number, name in enumerate(images)],
    }


def _surface_material() -> dict[str, Any]:
    return {
        "name": "surface",
        "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
    }


def _emitter_material(emitter: TexturedMesh) -> dict[str, Any]:
    """Black, as emitters are in our images; the emission is a colour of at most 1 times a strength."""
    strength = float(emitter.radiance.max())
    material: dict[str, Any] = {
        "name": emitter.name,
        "doubleSided": emitter.two_sided,
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1},
    }
    if strength > 0:
        material["emissiveFactor"] = (emitter.radiance.astype(np.float64) / strength).tolist()
        material["extensions"] = {_EMISSION: {"emissiveStrength": strength}}
    return material


def _mesh(piece: TexturedMesh, material: int, binary: _Binary) -> dict[str, Any]:
    primitive: dict[str, Any] = {"attributes": {"POSITION": binary.vectors(piece.mesh.vertices)}, "material": material}
    if material == 0:  # emitters have no textures
        primitive["attributes"]["TEXCOORD_0"] = binary.vectors(piece.uv)
    primitive["indices"] = binary.indices(piece.mesh.triangles)
    return {"name": piece.name, "primitives": [primitive]}


def _camera(camera: Camera) -> dict[str, Any]:
    """Field of view and shape of the image; glTF knows no principal point, which stands in the extras."""
    width, height = camera.width / camera.fx, camera.height / camera.fy
    perspective = {"yfov": 2 * float(np.arctan(height / 2)), "aspectRatio": width / height, "znear": _ENGINE_NEAR}
    keys = ("split", "width", "height", "cx", "cy")
    extras = {key: getattr(camera, key) for key in keys}
    return {"name": camera.name, "type": "perspective", "perspective": perspective, "extras": extras}


def _camera_node(camera: Camera, number: int) -> dict[str, Any]:
    matrix = np.asarray(camera.world_from_camera, np.float64).T.ravel().tolist()  # column by column
    return {"name": camera.name, "camera": number, "matrix": matrix}


def _point_light(emitter: TexturedMesh) -> dict[str, Any]:
    value = intensity(emitter)
    color = (value / value.max()).tolist()
    return {"name": emitter.name, "type": "point", "color": color, "intensity": float(value.max())}


def _light_node(emitter: TexturedMesh, number: int) -> dict[str, Any]:
    weight = emitter.mesh.areas[:, None] / emitter.mesh.areas.sum()
    center = (emitter.mesh.corners.mean(axis=1) * weight).sum(axis=0)
    name = f"{emitter.name}_point"
    return {"name": name, "translation": center.tolist(), "extensions": {_PUNCTUAL: {"light": number}}}


# --- reading --------------------------------------------------------------------------------------


def read_glb(path: str | Path) -> Asset:
    """Read a room that `write_glb` wrote; point lights, which repeat emitters, are left out.

    Raises
    ------
    FiptError
        If the file is missing, damaged or holds something else.
    """
    content = existing_file(path, "a glTF file").read_bytes()
    try:
        return _asset(*chunks(content))
    except (ValueError, KeyError, IndexError, TypeError, StopIteration, struct.error) as error:
        raise FiptError(f"{path} is not a room that fipt exported ({error!r})", "export it again") from error


def _asset(document: dict[str, Any], binary: bytes) -> Asset:
    def view(number: int) -> bytes:
        entry = document["bufferViews"][number]
        return binary[entry["byteOffset"] : entry["byteOffset"] + entry["byteLength"]]

    def array(number: int) -> np.ndarray:
        entry = document["accessors"][number]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[entry["type"]]
        kind = {_FLOAT: "<f4", _UINT: "<u4"}[entry["componentType"]]
        return np.frombuffer(view(entry["bufferView"]), kind, entry["count"] * width).reshape(-1, width)

    def image(texture: dict[str, int]) -> np.ndarray:
        from PIL import Image

        source = document["images"][document["textures"][texture["index"]]["source"]]
        with Image.open(io.BytesIO(view(source["bufferView"]))) as opened:
            return np.array(opened.convert("RGB"))

    def piece(node: dict[str, Any]) -> tuple[TexturedMesh, dict[str, Any]]:
        [primitive] = document["meshes"][node["mesh"]]["primitives"]
        material = document["materials"][primitive["material"]]
        vertices = array(primitive["attributes"]["POSITION"])
        coordinates = primitive["attributes"].get("TEXCOORD_0")
        uv = np.zeros((len(vertices), 2), np.float32) if coordinates is None else array(coordinates)
        strength = material.get("extensions", {}).get(_EMISSION, {}).get("emissiveStrength", 1.0)
        radiance = strength * np.array(material.get("emissiveFactor", (0, 0, 0)), np.float32)
        triangles = array(primitive["indices"]).reshape(-1, 3).astype(np.int32)
        return TexturedMesh(node["name"], Mesh(vertices, triangles), uv, radiance, material["doubleSided"]), material

    nodes = document["nodes"]
    [root] = document["scenes"][document["scene"]]["nodes"]
    children = [nodes[number] for number in nodes[root]["children"]]
    found = [piece(node) for node in children if "mesh" in node]
    (surface, material), *emitters = sorted(found, key=lambda entry: entry[1]["name"] != "surface")
    reflecting = material["pbrMetallicRoughness"]
    rest = image(reflecting["metallicRoughnessTexture"])
    textures = MaterialTextures(image(reflecting["baseColorTexture"]), rest[..., 1], rest[..., 2])
    cameras = [_read_camera(node, document["cameras"][node["camera"]]) for node in children if "camera" in node]
    return Asset(
        nodes[root]["name"],
        surface,
        tuple(emitter for emitter, _ in emitters),
        textures,
        tuple(cameras),
        NOTHING,
    )


def _read_camera(node: dict[str, Any], camera: dict[str, Any]) -> Camera:
    extras, perspective = camera["extras"], camera["perspective"]
    width, height = extras["width"], extras["height"]
    tan = np.tan(perspective["yfov"] / 2)
    return Camera(
        name=node["name"],
        split=extras["split"],
        width=width,
        height=height,
        fx=width / (2 * tan * perspective["aspectRatio"]),
        fy=height / (2 * tan),
        cx=extras["cx"],
        cy=extras["cy"],
        world_from_camera=np.array(node["matrix"], np.float64).reshape(4, 4).T,
    )
