"""Small object files for tests: a checkered cube as GLB, a coloured triangle as PLY, a square with a texture as OBJ."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from fipt.formats.glb import packed

RED, WHITE, BLUE = (200, 30, 20), (230, 225, 210), (20, 60, 220)


def picture() -> Image.Image:
    """Two by two fields of 8 x 8 texels: red and white above, white and blue below."""
    fields = np.array([[RED, WHITE], [WHITE, BLUE]], np.uint8)
    return Image.fromarray(fields.repeat(8, axis=0).repeat(8, axis=1))


def write_square_glb(path: Path, normals: bool = False) -> Path:
    """A unit square in z = 0 that faces +z, its texture upright: red at the upper left, blue at the lower right."""
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    material = PBRMaterial(baseColorTexture=picture(), roughnessFactor=0.4, metallicFactor=0.25)
    mesh = trimesh.Trimesh(
        corners,
        [[0, 1, 2], [0, 2, 3]],
        process=False,
        visual=TextureVisuals(uv=corners[:, :2] + 0.5, material=material),
    )
    path.write_bytes(mesh.export(file_type="glb", include_normals=normals))
    return path


def write_cube_glb(path: Path) -> Path:
    """A unit cube around the origin, the picture on every side."""
    cube = trimesh.creation.box([1, 1, 1])
    corners, normals = cube.vertices[cube.faces].reshape(-1, 3), cube.face_normals.repeat(3, axis=0)
    axis, row = np.abs(normals).argmax(axis=1), np.arange(len(corners))
    uv = np.stack([corners[row, (axis + 1) % 3], corners[row, (axis + 2) % 3]], axis=1) + 0.5
    visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=picture(), roughnessFactor=0.5))
    visual.material.metallicFactor = 0.0
    mesh = trimesh.Trimesh(corners, row.reshape(-1, 3), process=False, visual=visual)
    path.write_bytes(mesh.export(file_type="glb"))
    return path


def write_obj(path: Path) -> Path:
    """A unit square with the picture, by way of an MTL file."""
    content = BytesIO()
    picture().save(content, "PNG")
    (path.parent / "fields.png").write_bytes(content.getvalue())
    (path.parent / "fields.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd fields.png\n")
    corners = "v -0.5 -0.5 0\nv 0.5 -0.5 0\nv 0.5 0.5 0\nv -0.5 0.5 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    path.write_text(f"mtllib fields.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3 4/4\n")
    return path


CORNERS = np.float32([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
UPRIGHT = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])
"""Of the corners, as glTF has them: v = 0 is the top."""


def write_plain_glb(
    path: Path,
    attributes: Mapping[str, np.ndarray],
    material: Mapping[str, Any] | None = None,
    required: Sequence[str] = (),
) -> Path:
    """A square of such attributes of its corners, byte for byte; integers are normalized. Texture 0 is the picture."""
    content = BytesIO()
    picture().save(content, "PNG")
    parts = [(np.frombuffer(content.getvalue(), np.uint8), None)]
    parts += [(np.ascontiguousarray(values), f"VEC{values.shape[1]}") for values in attributes.values()]
    parts.append((np.uint16([0, 1, 2, 0, 2, 3]), "SCALAR"))
    kinds = {np.dtype(np.float32): 5126, np.dtype(np.uint16): 5123, np.dtype(np.uint8): 5121, np.dtype(np.int16): 5122}
    data, views, accessors = bytearray(), [], []
    for values, kind in parts:
        step = -(-values[0].nbytes // 4) * 4 if kind and kind.startswith("VEC") else values[0].nbytes
        rows = np.zeros((len(values), step), np.uint8)
        rows[:, : values[0].nbytes] = values.view(np.uint8).reshape(len(values), -1)
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": rows.nbytes})
        data += rows.tobytes()
        if kind is None:
            continue
        accessor = {"bufferView": len(views) - 1, "componentType": kinds[values.dtype], "count": len(values)}
        if kind != "SCALAR":
            views[-1]["byteStride"] = step
            accessor["normalized"] = values.dtype != np.float32
        accessors.append({**accessor, "type": kind})
    primitive = {"attributes": dict(zip(attributes, range(len(attributes)), strict=True)), "indices": len(attributes)}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive if material is None else {**primitive, "material": 0}]}],
        "materials": [] if material is None else [material],
        "images": [{"mimeType": "image/png", "bufferView": 0}],
        "textures": [{"source": 0}],
        "extensionsUsed": list(required),
        "extensionsRequired": list(required),
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    path.write_bytes(packed(document, data))
    return path
