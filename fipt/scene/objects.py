"""Objects to put into a room: PLY, OBJ and GLB files with their own materials, and shapes without a file.

Every object is a mesh with texture coordinates and materials whose maps repeat; row 0 of a map is v = 0. What carries
its colour at its vertices gets a map as well, of 2 x 2 texels for each triangle: bilinear values of three corners and
their parallelogram's fourth are linear over the triangle.
"""

import logging
import struct
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import FARTHEST, ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.formats.glb import chunks
from fipt.formats.images import as_rgb, srgb_decode
from fipt.scene.mesh import Mesh
from fipt.scene.mtl import defined_materials, is_there, material_files, texture_files
from fipt.scene.obj import check_whole

log = logging.getLogger(__name__)

KINDS = (".ply", ".obj", ".glb")
MANY = 1_000_000
"""Triangles above which an object is taken, with a warning."""
_NEUTRAL = (0.5, 0.6, 0.0)
"""Base colour, roughness and metallic of what has no material."""
_SUBDIVISIONS = 5


@dataclass(frozen=True)
class ObjectMaterial:
    """Maps of one material: base_color (h, w, 3), roughness (h, w), metallic (h, w), float32, each of its own size."""

    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray

    def changed(
        self, color: tuple[float, ...] | None, roughness: float | None, metallic: float | None
    ) -> "ObjectMaterial":
        """Return the material with constants in place of some maps."""
        return ObjectMaterial(
            self.base_color if color is None else np.full((1, 1, 3), color, np.float32),
            self.roughness if roughness is None else np.full((1, 1), roughness, np.float32),
            self.metallic if metallic is None else np.full((1, 1), metallic, np.float32),
        )


def uniform(base_color: Any, roughness: float, metallic: float) -> ObjectMaterial:
    """Return a material that is the same everywhere."""
    nothing = np.zeros((1, 1), np.float32)
    return ObjectMaterial(np.zeros((1, 1, 3), np.float32), nothing, nothing).changed(base_color, roughness, metallic)


@dataclass(frozen=True)
class MeshObject:
    """A mesh with materials.

    Attributes
    ----------
    mesh
        V vertices and T triangles.
    normals
        (V, 3) float32 unit normals at the vertices; zero where a triangle shows its flat one.
    uv
        (V, 2) float32 texture coordinates.
    materials, material
        All materials; (T,) int32 which one each triangle has.
    """

    mesh: Mesh
    normals: np.ndarray
    uv: np.ndarray
    materials: tuple[ObjectMaterial, ...]
    material: np.ndarray

    def changed(self, color: tuple[float, ...] | None, roughness: float | None, metallic: float | None) -> "MeshObject":
        """Return the object with constants in place of some of its materials' maps."""
        return replace(self, materials=tuple(m.changed(color, roughness, metallic) for m in self.materials))

    def at(self, triangle: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Material of N places, given by their triangles (N,) and barycentric weights (N, 3).

        Returns
        -------
        base_color (N, 3), roughness (N,), metallic (N,), float32
        """
        uv = np.einsum("nk,nkc->nc", weights, self.uv[self.mesh.triangles[triangle]])
        color, rest = np.empty((len(uv), 3), np.float32), np.empty((2, len(uv)), np.float32)
        own = self.material[triangle]
        for number in np.unique(own):
            chosen, maps = own == number, self.materials[number]
            color[chosen] = bilinear(maps.base_color, uv[chosen])
            for row, values in zip(rest, (maps.roughness, maps.metallic), strict=True):
                row[chosen] = bilinear(values[..., None], uv[chosen])[:, 0]
        return color, np.maximum(rest[0], ROUGHNESS_MIN), rest[1]


def joined(objects: list[MeshObject]) -> MeshObject:
    """All objects, at least one, as one; their triangles follow one another."""
    vertex = np.cumsum([0] + [len(thing.mesh.vertices) for thing in objects])
    number = np.cumsum([0] + [len(thing.materials) for thing in objects])
    mesh = Mesh(
        np.concatenate([thing.mesh.vertices for thing in objects]),
        np.concatenate([o.mesh.triangles + start for o, start in zip(objects, vertex, strict=False)]).astype(np.int32),
    )
    return MeshObject(
        mesh,
        np.concatenate([thing.normals for thing in objects]),
        np.concatenate([thing.uv for thing in objects]),
        tuple(material for thing in objects for material in thing.materials),
        np.concatenate([o.material + start for o, start in zip(objects, number, strict=False)]).astype(np.int32),
    )


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, C) values of an (h, w, C) map that repeats, at (N, 2) places; texel centres are at half integers."""
    height, width = image.shape[:2]
    x, y = (uv[:, 0] % 1.0) * width - 0.5, (uv[:, 1] % 1.0) * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    tx, ty = (x - left)[:, None], (y - top)[:, None]
    left, right, top, bottom = left % width, (left + 1) % width, top % height, (top + 1) % height
    upper = image[top, left] * (1 - tx) + image[top, right] * tx
    lower = image[bottom, left] * (1 - tx) + image[bottom, right] * tx
    return upper * (1 - ty) + lower * ty


def moved(
    vertices: np.ndarray, normals: np.ndarray, matrix: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (zero where there is none), both (V, 3), after a (3, 3) matrix and a shift; float32."""
    turned = normals @ np.linalg.inv(matrix)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    turned /= np.where(length > 0, length, 1.0)
    return (vertices @ matrix.T + shift).astype(np.float32), turned.astype(np.float32)


# --- shapes ---------------------------------------------------------------------------------------


def shape_object(shape: str, size: float) -> MeshObject:
    """Return a neutral ``sphere`` of that diameter with smooth normals, or a ``cube`` of that side, centred."""
    import trimesh

    round_ = shape == "sphere"
    made = trimesh.creation.icosphere(_SUBDIVISIONS, size / 2) if round_ else trimesh.creation.box([size] * 3)
    mesh = Mesh(np.asarray(made.vertices, np.float32), np.asarray(made.faces, np.int32))
    normals = mesh.vertices / (size / 2) if round_ else np.zeros_like(mesh.vertices)
    return MeshObject(
        mesh,
        normals.astype(np.float32),
        np.zeros((len(mesh.vertices), 2), np.float32),
        (uniform(*_NEUTRAL),),
        np.zeros(len(mesh.triangles), np.int32),
    )


# --- files ----------------------------------------------------------------------------------------


def read_object(path: str | Path) -> MeshObject:
    """Read a file with its materials.

    GLB: base colour, roughness and metallic, factors (8 bits) and textures; OBJ: Kd, Ns and map_Kd of its MTL file;
    PLY: colours of its vertices. Without any of these it is neutral. Normal maps, emission and transparency are left
    out.

    Raises
    ------
    FiptError
        If the file is missing, no mesh, or an image in it cannot be read.
    """
    path = existing_file(path, "an object's file")
    if path.suffix.lower() not in KINDS:
        raise FiptError(f"an object must be a PLY, OBJ or GLB file; found {path}", "convert it")
    import trimesh

    if path.suffix.lower() == ".glb":
        _check_images(path)
    defined = defined_materials(path) if path.suffix.lower() == ".obj" else None
    try:
        if defined is not None:
            check_whole(path)
        scene = trimesh.load_scene(path, process=False)
        nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
        found = [(scene.geometry[name], placed) for placed, name in nodes]
        linear = path.suffix.lower() == ".glb"  # glTF's colours of vertices are, the others' are sRGB
        pieces = [_piece(mesh, placed, linear, defined) for mesh, placed in found if len(getattr(mesh, "faces", ()))]
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise FiptError(
            f"{path} is not a readable mesh ({error or type(error).__name__})", "give a PLY, OBJ or GLB with triangles"
        ) from error
    if not pieces:
        raise FiptError(f"{path} holds no triangles", "give a PLY, OBJ or GLB file with triangles")
    made = joined(pieces)
    bad = ~(np.abs(made.mesh.vertices) <= FARTHEST).all(axis=1)
    if bad.any():
        said = f"{int(bad.sum())} vertices that are NaN, infinite or farther than {FARTHEST:.0e} from its origin"
        raise FiptError(f"{path} has {said}", "repair the mesh")
    if not made.mesh.areas.any():
        raise FiptError(f"none of the triangles of {path} has an area", "repair the mesh")
    if len(made.mesh.triangles) > MANY:
        log.warning("%s has %d triangles; fewer would be faster", path, len(made.mesh.triangles))
    return made


def object_files(path: str | Path) -> list[str]:
    """Return an object's file and those that it refers to: an OBJ's materials and their images that exist."""
    files = [Path(path)]
    if files[0].suffix.lower() == ".obj" and files[0].is_file():
        materials = [file for file in material_files(files[0]) if is_there(file)]
        images = [image for file in materials for image in texture_files(file) if is_there(image)]
        files += [*materials, *images]
    return [str(file) for file in dict.fromkeys(files)]


def _piece(piece: Any, placed: np.ndarray, linear_colors: bool, defined: set[str] | None) -> MeshObject:
    """One mesh of trimesh where its (4, 4) matrix puts it, with its normals, texture coordinates and material.

    ``defined``: names of the materials that count; trimesh makes one up where a file has none. None: all do.
    """
    vertices, triangles = np.asarray(piece.vertices), np.asarray(piece.faces, np.int32)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError("it refers to vertices it does not have")
    # trimesh makes up what a file lacks; only what it read is in the cache before it is asked
    given = piece._cache.cache.get("vertex_normals")
    normals = np.zeros_like(vertices) if given is None else np.asarray(given)
    vertices, normals = moved(vertices, np.nan_to_num(normals, posinf=0, neginf=0), placed[:3, :3], placed[:3, 3])
    material, uv = uniform(*_NEUTRAL), None
    visual = piece.visual
    if visual.kind == "texture" and visual.material is not None:
        uv = visual.uv
        if defined is None or visual.material.name in defined:
            material = _material(visual.material)
    elif visual.kind == "vertex":
        colors = np.asarray(visual.vertex_colors)[:, :3] / 255.0
        colors = colors if linear_colors else srgb_decode(colors)
        return _painted(Mesh(vertices, triangles), normals, colors)
    uv = np.zeros((len(vertices), 2)) if uv is None else np.asarray(uv)[:, :2] * (1, -1) + (0, 1)  # v = 0 is the top
    uv = np.nan_to_num(uv, posinf=0, neginf=0)
    return MeshObject(
        Mesh(vertices, triangles), normals, uv.astype(np.float32), (material,), np.zeros(len(triangles), np.int32)
    )


def _material(found: Any) -> ObjectMaterial:
    """A material of trimesh: textures times factors."""
    metal_if_unsaid = 1.0  # as in glTF
    if hasattr(found, "to_pbr"):  # of OBJ, whose materials know no metal
        found, metal_if_unsaid = found.to_pbr(), 0.0
    factor = np.ones(3) if found.baseColorFactor is None else np.asarray(found.baseColorFactor)[:3] / 255.0
    color = np.ones((1, 1, 3))
    if found.baseColorTexture is not None:
        color = srgb_decode(as_rgb(found.baseColorTexture))
    rest = np.ones((1, 1, 3))
    if found.metallicRoughnessTexture is not None:
        rest = as_rgb(found.metallicRoughnessTexture)
    rough = 1.0 if found.roughnessFactor is None else found.roughnessFactor
    metal = metal_if_unsaid if found.metallicFactor is None else found.metallicFactor
    maps = color * factor, np.clip(rest[..., 1] * rough, ROUGHNESS_MIN, 1), np.clip(rest[..., 2] * metal, 0, 1)
    return ObjectMaterial(*(values.astype(np.float32) for values in maps))


def _painted(mesh: Mesh, normals: np.ndarray, colors: np.ndarray) -> MeshObject:
    """A mesh whose base colour (V, 3) is at its vertices: 2 x 2 texels for each triangle."""
    count = len(mesh.triangles)
    across = int(np.ceil(np.sqrt(count)))
    a, b, c = np.moveaxis(colors[mesh.triangles], 1, 0)
    blocks = np.zeros((across * across, 2, 2, 3), np.float32)
    blocks[:count] = np.stack([a, b, c, b + c - a], axis=1).reshape(count, 2, 2, 3)
    image = blocks.reshape(across, across, 2, 2, 3).swapaxes(1, 2).reshape(2 * across, 2 * across, 3)
    row, column = np.divmod(np.arange(count), across)
    corner = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    uv = (2 * np.stack([column, row], axis=1)[:, None] + corner) / (2 * across)
    corners = mesh.triangles.reshape(-1)
    return MeshObject(
        Mesh(mesh.vertices[corners], np.arange(3 * count, dtype=np.int32).reshape(-1, 3)),
        normals[corners],
        uv.reshape(-1, 2).astype(np.float32),
        (replace(uniform(*_NEUTRAL), base_color=image),),
        np.zeros(count, np.int32),
    )


def _check_images(path: Path) -> None:
    """Raise an error that names the first image of a GLB that cannot be read; trimesh would leave it out silently."""
    from PIL import Image

    try:
        document, binary = chunks(path.read_bytes())
    except (struct.error, ValueError) as error:
        raise FiptError(f"{path} is not a readable mesh ({error})", "export it again") from error
    for number, image in enumerate(document.get("images", [])):
        name = image.get("name") or image.get("uri") or str(number)
        kind = image.get("mimeType", "of unknown kind")
        try:
            if "bufferView" not in image:
                raise ValueError("it is not inside the file")
            view = document["bufferViews"][image["bufferView"]]
            start = view.get("byteOffset", 0)
            with Image.open(BytesIO(binary[start : start + view["byteLength"]])) as opened:
                opened.load()
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            raise FiptError(
                f"the image {name!r} ({kind}) in {path} cannot be read",
                "export the file with PNG or JPEG textures inside",
            ) from error
