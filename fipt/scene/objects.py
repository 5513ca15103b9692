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
from fipt.formats.glb import chunks, with_floats
from fipt.formats.images import as_rgb, srgb_decode
from fipt.scene.mesh import Mesh
from fipt.scene.mtl import NamedFiles, defined_materials, is_there, material_files, texture_files
from fipt.scene.obj import check_whole

log = logging.getLogger(__name__)

KINDS = (".ply", ".obj", ".glb")
MANY = 1_000_000
"""Triangles above which an object is taken, with a warning."""
_NEUTRAL = (0.5, 0.6, 0.0)
"""Base colour, roughness and metallic of what has no material."""
_SUBDIVISIONS = 5
_EXTENSIONS = ("KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual", "EXT_texture_webp")
"""Of glTF, beside materials: what is read, checked where it is used, or left out as lights are."""
_NO_TRANSFORM = {"offset": [0, 0], "scale": [1, 1], "rotation": 0}


@dataclass(frozen=True)
class ObjectMaterial:
    """Maps of one material: base_color (h, w, 3), roughness (h, w), metallic (h, w), float32, each of its own size."""

    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray

    @property
    def is_uniform(self) -> bool:
        """Whether it is the same everywhere."""
        return self.base_color.shape[:2] == self.roughness.shape == self.metallic.shape == (1, 1)

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
    """All objects, at least one, as one; their triangles follow one another, a material they share is there once."""
    vertex = np.cumsum([0] + [len(thing.mesh.vertices) for thing in objects])
    shared = {id(material): material for thing in objects for material in thing.materials}
    number = {key: position for position, key in enumerate(shared)}
    mesh = Mesh(
        np.concatenate([thing.mesh.vertices for thing in objects]),
        np.concatenate([o.mesh.triangles + start for o, start in zip(objects, vertex, strict=False)]).astype(np.int32),
    )
    return MeshObject(
        mesh,
        np.concatenate([thing.normals for thing in objects]),
        np.concatenate([thing.uv for thing in objects]),
        tuple(shared.values()),
        np.concatenate([np.array([number[id(own)] for own in o.materials], np.int32)[o.material] for o in objects]),
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

    GLB: base colour, roughness and metallic, factors (8 bits) and textures, colours of vertices; OBJ: Kd, Ns and map_Kd
    of its MTL file; PLY: colours of its vertices. Without any of these it is neutral. Normal maps, emission and
    transparency are left out.

    Raises
    ------
    FiptError
        If the file is missing, no mesh, or needs an extension of glTF that is not read; if an image in it cannot be
        read.
    """
    path = existing_file(path, "an object's file")
    if path.suffix.lower() not in KINDS:
        raise FiptError(f"an object must be a PLY, OBJ or GLB file; found {path}", "convert it")
    if path.suffix.lower() == ".glb":
        _check_glb(path)
    defined = defined_materials(path) if path.suffix.lower() == ".obj" else None
    try:
        if defined is not None:
            check_whole(path)
        pieces = _pieces(path, defined)
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


def _pieces(path: Path, defined: set[str] | None) -> list[MeshObject]:
    """The meshes of a file where its scene puts them.

    ``defined``: names of the materials that count; trimesh makes one up where a file has none. None: all do.
    """
    scene = _loaded(path)
    made: dict[int, ObjectMaterial] = {}  # by the object of trimesh: parts share materials
    pieces = []
    for placed, name in (scene.graph[node] for node in scene.graph.nodes_geometry):
        mesh = scene.geometry[name]
        if not len(getattr(mesh, "faces", ())):
            continue
        found = getattr(mesh.visual, "material", None)
        if found is None or (defined is not None and found.name not in defined):
            material = uniform(*_NEUTRAL)
        else:
            material = made[id(found)] = made.get(id(found)) or _material(found)
        pieces.append(_piece(path, mesh, placed, material))
    return pieces


def _loaded(path: Path) -> Any:
    """A file as a scene of trimesh."""
    import trimesh

    kind = path.suffix.lower()
    if kind == ".glb":  # of normalized integers trimesh reads those of colours alone, of 8 bits
        return trimesh.load_scene(BytesIO(with_floats(path.read_bytes())), file_type="glb", process=False)
    files = NamedFiles(path.parent) if kind == ".obj" else None
    return trimesh.load_scene(path, process=False, resolver=files)  # pyright: ignore[reportArgumentType]


def _piece(path: Path, piece: Any, placed: np.ndarray, material: ObjectMaterial) -> MeshObject:
    """One mesh of trimesh where its (4, 4) matrix puts it, with its normals, texture coordinates and material."""
    vertices, triangles = np.asarray(piece.vertices), np.asarray(piece.faces, np.int32)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError("it refers to vertices it does not have")
    # trimesh makes up what a file lacks; only what it read is in the cache before it is asked
    given = piece._cache.cache.get("vertex_normals")
    normals = np.zeros_like(vertices) if given is None else np.asarray(given)
    vertices, normals = moved(vertices, np.nan_to_num(normals, posinf=0, neginf=0), placed[:3, :3], placed[:3, 3])
    visual, uv = piece.visual, None
    if visual.kind == "vertex":
        colors = np.asarray(visual.vertex_colors)[:, :3] / 255.0
        colors = colors if path.suffix.lower() == ".glb" else srgb_decode(colors)  # glTF's are linear
        return _painted(Mesh(vertices, triangles), normals, colors, material)
    if visual.kind == "texture":
        uv, colors = visual.uv, visual.vertex_attributes.get("color")
        if colors is not None and material.is_uniform:
            colors = material.base_color[0, 0] * np.clip(colors, 0, 1)[:, :3]
            return _painted(Mesh(vertices, triangles), normals, colors, material)
        if colors is not None and (colors[:, :3] < 1).any():
            log.warning("%s has colours of vertices beside a texture: these colours are left out", path)
    uv = np.zeros((len(vertices), 2)) if uv is None else np.asarray(uv)[:, :2] * (1, -1) + (0, 1)  # v = 0 is the top
    uv = np.nan_to_num(uv, posinf=0, neginf=0)
    return MeshObject(
        Mesh(vertices, triangles), normals, uv.astype(np.float32), (material,), np.zeros(len(triangles), np.int32)
    )


def _material(found: Any) -> ObjectMaterial:
    """A material of trimesh: textures times factors."""
    color_if_unsaid, metal_if_unsaid = 1.0, 1.0  # as in glTF
    if hasattr(found, "to_pbr"):  # of OBJ, whose materials know no metal
        has_kd, found, metal_if_unsaid = "kd" in found.kwargs, found.to_pbr(), 0.0
        if not has_kd:  # trimesh makes them a dark grey
            found.baseColorFactor = None
            color_if_unsaid = _NEUTRAL[0] if found.baseColorTexture is None else 1.0
    factor = np.full(3, color_if_unsaid)
    if found.baseColorFactor is not None:
        factor = np.asarray(found.baseColorFactor)[:3] / 255.0
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


def _painted(mesh: Mesh, normals: np.ndarray, colors: np.ndarray, material: ObjectMaterial) -> MeshObject:
    """A mesh whose base colour (V, 3) is at its vertices, 2 x 2 texels a triangle; the rest is of ``material``."""
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
        (replace(material, base_color=image),),
        np.zeros(count, np.int32),
    )


def _check_glb(path: Path) -> None:
    """Raise an error that names what of a GLB cannot be read; trimesh would leave it out silently."""
    try:
        document, binary = chunks(path.read_bytes())
    except (struct.error, ValueError) as error:
        raise FiptError(f"{path} is not a readable mesh ({error})", "export it again") from error
    for name in document.get("extensionsRequired", []):
        if name not in _EXTENSIONS and not name.startswith("KHR_materials_"):
            raise FiptError(f"{path} needs the glTF extension {name}, which is not read", "export it without")
    for material in document.get("materials", []):
        maps = material.get("pbrMetallicRoughness", {})
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            _check_texture(path, material.get("name", "without a name"), maps.get(key, {}))
    _check_images(path, document, binary)


def _check_texture(path: Path, material: str, texture: dict[str, Any]) -> None:
    """Refuse a texture that lies otherwise than by the first texture coordinates."""
    moved_by = texture.get("extensions", {}).get("KHR_texture_transform", {})
    if moved_by.get("texCoord", texture.get("texCoord", 0)) != 0:
        said = "has a texture on its second texture coordinates; the first alone are read"
    elif {key: value for key, value in moved_by.items() if key != "texCoord" and value != _NO_TRANSFORM.get(key)}:
        said = "moves or scales a texture (KHR_texture_transform), which is not read"
    else:
        return
    raise FiptError(f"the material {material!r} in {path} {said}", "apply it to the texture coordinates, or bake it")


def _check_images(path: Path, document: dict[str, Any], binary: bytes) -> None:
    """Refuse an image that cannot be read."""
    from PIL import Image

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
