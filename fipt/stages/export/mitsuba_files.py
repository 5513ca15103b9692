"""Mitsuba 3 scene files: with its own principled reflectance, and with ours as a plugin file."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from fipt import __version__, conventions
from fipt.formats.exr import write_exr
from fipt.formats.files import atomic, write_text
from fipt.formats.images import write_png
from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh
from fipt.scene.cameras import Camera
from fipt.stages.export.cameras import distinct

PLUGIN = "fipt_bsdf.py"
PLUGIN_TYPE = "fipt_ggx"

_PLUGIN_HEAD = '''"""The reflectance that fipt fits, as a plugin of Mitsuba 3.

Choose a variant of llvm or cuda (``mi.set_variant``), import this file, then ``mi.load_file("scene_exact.xml")``.
Nothing of fipt is needed. MIT licence.
"""

'''


def write_mitsuba(
    folder: Path,
    asset: Asset,
    principled: MaterialTextures,
    specular: float,
    environment: np.ndarray | None,
    max_depth: int,
) -> None:
    """Write scene.xml, scene_exact.xml and what they name.

    Parameters
    ----------
    folder
        To write to; the textures stand in ``../textures``.
    asset
        The room.
    principled, specular
        Parameters of Mitsuba's own reflectance.
    environment
        (h, w, 3) the outside as Mitsuba's map; None where none shines.
    max_depth
        Longest path, bounces.
    """
    sheets = [asset.surface, *asset.sheets]
    for piece in sheets:
        _write_ply(folder / f"{piece.name}.ply", piece)
    for name in ("base_color", "roughness"):
        write_png(folder / f"principled_{name}.png", getattr(principled, name))
    write_text(folder / PLUGIN, plugin_source())
    if environment is not None:
        write_exr(folder / "environment.exr", {"": environment})
    for name, kind in (("scene.xml", "principled"), ("scene_exact.xml", PLUGIN_TYPE)):
        write_text(folder / name, _scene(asset, sheets, kind, specular, environment is not None, max_depth))


def plugin_source() -> str:
    """Return the plugin: the reflectance that we render with, its constants written out, registered on import."""
    module = (Path(__file__).parents[2] / "render" / "bsdf_plugin.py").read_text(encoding="utf-8")
    imports = "from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_MIN\n"
    _, _, code = module.partition('"""\n\n')
    constants = "".join(f"{name} = {getattr(conventions, name)}\n" for name in ("F0_DIELECTRIC", "ROUGHNESS_MIN"))
    return f"{_PLUGIN_HEAD}{code.replace(imports, constants)}"


def _scene(asset: Asset, sheets: list[TexturedMesh], kind: str, specular: float, outside: bool, max_depth: int) -> str:
    root = Element("scene", version="3.0.0")
    SubElement(root, "default", name="spp", value="256")
    integrator = SubElement(root, "integrator", type="path")
    _add(integrator, "integer", "max_depth", max_depth + 1)  # Mitsuba counts a path's edges
    names = distinct([f"view_{camera.name.replace('.', '_')}" for camera in asset.cameras])
    for camera, name in zip(asset.cameras, names, strict=True):
        _sensor(root, camera, name)
    surface = _surface(root, kind, specular)
    for piece in sheets:
        shape = SubElement(root, "shape", type="ply", id=piece.name)
        _add(shape, "string", "filename", f"{piece.name}.ply")
        _add(shape, "boolean", "face_normals", "true")
        if piece is asset.surface:
            SubElement(shape, "ref", id=surface)
            continue
        black = SubElement(shape, "bsdf", type="diffuse")
        _add(black, "rgb", "reflectance", "0")
        if piece.radiance.any():
            light = SubElement(shape, "emitter", type="area")
            _add(light, "rgb", "radiance", _numbers(piece.radiance))
    if outside:
        _add(SubElement(root, "emitter", type="envmap"), "string", "filename", "environment.exr")
    indent(root)
    head = f"<!-- {asset.name}, written by fipt {__version__} -->\n"
    return head + tostring(root, encoding="unicode") + "\n"


def _surface(root: Element, kind: str, specular: float) -> str:
    """Add the reflectance; return its id."""
    exact = kind == PLUGIN_TYPE
    outer = root if exact else SubElement(root, "bsdf", type="twosided", id="surface_material")
    bsdf = SubElement(outer, "bsdf", type=kind)
    if exact:
        bsdf.set("id", "surface_material")
    folder = "../textures/" if exact else "principled_"
    for name, file, raw in (
        ("base_color", f"{folder}base_color.png", "false"),
        ("roughness", f"{folder}roughness.png", "true"),
        ("metallic", "../textures/metallic.png", "true"),
    ):
        texture = SubElement(bsdf, "texture", type="bitmap", name=name)
        _add(texture, "string", "filename", file)
        _add(texture, "boolean", "raw", raw)
        _add(texture, "string", "wrap_mode", "clamp")
    if not exact:
        _add(bsdf, "float", "specular", specular)
    return "surface_material"


def _sensor(root: Element, camera: Camera, name: str) -> None:
    """Add a view under a name. Mitsuba's cameras look along z, x to the left; their pixels are square."""
    sensor = SubElement(root, "sensor", type="perspective", id=name)
    _add(sensor, "string", "fov_axis", "x")
    _add(sensor, "float", "fov", float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))))
    _add(sensor, "float", "near_clip", 0.001)
    _add(sensor, "float", "far_clip", 1000)
    _add(sensor, "float", "principal_point_offset_x", 0.5 - camera.cx / camera.width)
    _add(sensor, "float", "principal_point_offset_y", 0.5 - camera.cy / camera.height)
    pose = camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])
    SubElement(SubElement(sensor, "transform", name="to_world"), "matrix", value=_numbers(pose))
    film = SubElement(sensor, "film", type="hdrfilm")
    _add(film, "integer", "width", camera.width)
    _add(film, "integer", "height", camera.height)
    _add(film, "string", "pixel_format", "rgb")
    _add(film, "string", "component_format", "float32")
    SubElement(film, "rfilter", type="box")
    sampler = SubElement(sensor, "sampler", type="independent")
    _add(sampler, "integer", "sample_count", "$spp")


def _add(parent: Element, tag: str, name: str, value: object) -> None:
    SubElement(parent, tag, name=name, value=str(value))


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _write_ply(path: Path, piece: TexturedMesh) -> None:
    """Binary PLY with texture coordinates as Mitsuba reads them (u, v)."""
    vertices = np.column_stack([piece.mesh.vertices, piece.uv]).astype("<f4")
    faces = np.zeros(len(piece.mesh.triangles), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, piece.mesh.triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "u", "v")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with atomic(path) as temporary, open(temporary, "wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())
