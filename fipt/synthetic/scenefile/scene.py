"""Reads a Mitsuba scene file: surfaces, materials and lights of a room, in metres, y up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.scenefile import lights
from fipt.synthetic.scenefile.interior import Interior, close_openings, find_interior
from fipt.synthetic.scenefile.materials import MATTE, ConvertedBsdf, converted, described, material, note_ignored
from fipt.synthetic.scenefile.shapes import ShapeGeometry, cut, geometry, placed, without_slivers
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.values import transform
from fipt.synthetic.scenefile.xml import Node, read_tree, scene_files
from fipt.synthetic.settings import SceneFile

__all__ = ["SceneContent", "SceneShape", "read_scene", "scene_files"]

_HEIGHT = 2.7
_PLAUSIBLE = (1.8, 8.0)
"""Heights of an interior, metres, at which the file's unit is taken for the metre."""


@dataclass(frozen=True)
class SceneShape:
    """The triangles of a shape.

    Attributes
    ----------
    name
        Unique in the scene.
    vertices
        (V, 3) float32, metres, y up.
    triangles
        (T, 3) int32, none of them degenerate; what emits does so on the side from which they are counter-clockwise.
    uv
        (V, 2) float32 coordinates of the material's maps, zero where there are none.
    material
        Index into the scene's materials.
    radiance
        (3,) float32 emitted radiance, or None.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    material: int
    radiance: np.ndarray | None


@dataclass(frozen=True)
class SceneContent:
    """A room from a scene file.

    Attributes
    ----------
    surfaces
        In the file's order, then lamps that stand for point lights, then quads in the openings.
    materials
        Those of the surfaces, in the order of their first use.
    background
        Light from outside, y up.
    box
        (2, 3) float32 lower and upper corner of the interior, metres.
    notes
        One line for each material, and for all that was dropped, approximated or replaced.
    files
        Every file that was read, the scene file first.
    """

    surfaces: list[SceneShape]
    materials: list[RoomMaterial]
    environment: EnvironmentMap
    box: np.ndarray
    notes: list[str]
    files: list[Path]


def read_scene(path: str | Path, settings: SceneFile) -> SceneContent:
    """Read a scene file; Mitsuba's variant must be set.

    Raises
    ------
    FiptError
        If it cannot be read, refers outside its folder, lacks files or has unknown plugins (unless ``allow_missing``),
        has no interior or no light, or, with ``environment: quads``, cannot be closed.
    """
    path = Path(path)
    tree = read_tree(path)
    source = SceneFileReader(path, settings)
    turn = _turn(tree.root, source)
    world = np.eye(4)
    world[:3, :3] = turn

    builder = _Builder(source)
    shapes = list(placed(tree.root, source))
    with progress("scene", len(shapes), " shapes") as bar:
        for shape in shapes:
            builder.add(shape.name, shape.node, _turned(geometry(shape, source), turn))
            bar.advance(note=shape.name)
    note_ignored(tree.root, source)
    environment = lights.outside(tree.root, turn, source)
    small = lights.point_emitters(tree.root, source)
    source.check()
    if not builder.surfaces:
        raise FiptError(f"{path} has no surfaces", "give a scene file with shapes that reflect light")

    cameras = [world @ transform(node.get("to_world")) for node in tree.root.objects("sensor")]
    mesh = builder.mesh()
    rays = RayScene(mesh)
    interior = find_interior(mesh, rays, cameras, str(path))
    scale = _scale(interior, source)
    if scale != 1:
        interior = interior.scaled(scale)
        builder.scale(scale)
        rays = RayScene(builder.mesh())
    for emitter in small:
        direction = None if emitter.direction is None else turn @ emitter.direction
        vertices, triangles = lights.emitter_shape(emitter, scale * turn @ emitter.position, direction)
        builder.add_light(emitter.name, vertices, triangles, lights.emitter_radiance(emitter, scale))
    environment = _let_in(environment, builder, rays, interior, source)
    if not environment.emits and not any(surface.radiance is not None for surface in builder.surfaces):
        raise FiptError(
            f"{path} has no light: no area, point or spot light that shines, and none from outside",
            "add an emitter to the scene file, or do not set environment: drop",
        )
    return SceneContent(
        surfaces=builder.surfaces,
        materials=builder.materials,
        environment=environment,
        box=interior.box.astype(np.float32),
        notes=builder.notes() + source.notes,
        files=tree.files + source.files,
    )


def _turn(scene: Node, source: SceneFileReader) -> np.ndarray:
    """(3, 3) rotation that makes y up."""
    up = source.settings.up
    if up == "auto":
        sensors = scene.objects("sensor")
        axis = transform(sensors[0].get("to_world"))[:3, 1] if sensors else np.array([0.0, 1, 0])
        up = "z" if abs(axis[2]) > abs(axis[1]) else "y"
        if up == "z":
            source.note("z is up in the file, as its camera shows; turned so that y is: (x, y, z) becomes (x, z, -y)")
    return lights.Z_UP if up == "z" else np.eye(3)


def _turned(shape: ShapeGeometry | None, turn: np.ndarray) -> ShapeGeometry | None:
    return shape and ShapeGeometry(shape.vertices @ turn.T, shape.triangles, shape.uv)


def _scale(interior: Interior, source: SceneFileReader) -> float:
    """Metres in a unit of the file."""
    height = float(np.ptp(interior.box[:, 1]))
    if source.settings.scale is not None:
        return source.settings.scale
    if _PLAUSIBLE[0] <= height <= _PLAUSIBLE[1]:
        return 1.0
    scale = _HEIGHT / height
    source.note(
        f"the interior is {height:.3g} units high: a unit is taken for {scale:.4g} m, which makes it {_HEIGHT} m"
    )
    return scale


def _let_in(
    environment: EnvironmentMap, builder: _Builder, rays: RayScene, interior: Interior, source: SceneFileReader
) -> EnvironmentMap:
    """Return the background that stays; with ``quads``, put the light from outside into the openings."""
    if source.settings.environment == "keep" or not environment.emits:
        return environment
    if source.settings.environment == "drop":
        source.note("light from outside: dropped (environment: drop)")
        return NOTHING
    openings, share = close_openings(rays, interior, environment, str(source.path))
    for number, opening in enumerate(openings):
        triangles = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
        builder.add_light(f"opening-{number}", opening.corners, triangles, opening.radiance)
        size = np.sort(np.ptp(opening.corners, axis=0))[1:]
        center, radiance = (
            ", ".join(f"{v:.3g}" for v in values) for values in (opening.corners.mean(0), opening.radiance)
        )
        source.note(f"opening at {center}: closed by a quad of {size[1]:.2f} x {size[0]:.2f} m, radiance {radiance}")
    source.note(
        f"light from outside: {len(openings)} quads in its openings; {share:.2%} of the rays still leave the room"
    )
    return NOTHING


class _Builder:
    """Gathers surfaces and the materials they use."""

    def __init__(self, source: SceneFileReader) -> None:
        self.source = source
        self.surfaces: list[SceneShape] = []
        self.materials: list[RoomMaterial] = []
        self._conversions: dict[str, ConvertedBsdf] = {}
        self._index: dict[str, int] = {}
        self._found: list[ConvertedBsdf | None] = []
        self._names: set[str] = set()
        self._clear: dict[str, int] = {}
        self._slivers = 0

    def add(self, name: str, node: Node, shape: ShapeGeometry | None) -> None:
        """Add a shape unless light passes through it; what emits is kept whatever it is made of."""
        bsdf = (node.objects("bsdf") or [_DEFAULT])[0]
        key = _content(bsdf)
        known = self._conversions.get(key)
        if known is None:
            known = self._conversions[key] = converted(bsdf, self.source)
        if len(node.objects("bsdf")) > 1:
            self.source.note(f"shape {name}: has several bsdfs; the first is used for all of it")
        radiance = lights.radiance(node, self.source)
        if radiance is not None and not radiance.any():
            self.source.note(f"light {name}: its radiance is zero; it reflects like any surface")
            radiance = None
        if radiance is None and known.clear:
            what = _bsdf_name(bsdf, name)
            self._clear[f"{what} ({known.rule})"] = self._clear.get(f"{what} ({known.rule})", 0) + 1
            return
        if shape is None:
            return
        if bsdf is _DEFAULT:
            self.source.note(f"shape {name}: has no bsdf; Mitsuba's default, grey 0.5")
        before = len(shape.triangles)
        shape = without_slivers(shape)
        self._slivers += before - len(shape.triangles)
        if known.opacity is not None and radiance is None:
            shape = cut(shape, known.opacity)
        if not len(shape.triangles):
            self.source.note(f"shape {name}: nothing is left of it")
            return
        index = self._material(bsdf, name, known)
        uv = np.zeros((len(shape.vertices), 2))
        if shape.uv is not None:
            uv = shape.uv @ known.from_uv[:, :2].T + known.from_uv[:, 2]
        elif known.textures:
            self.source.note(f"shape {name}: has no texture coordinates; its texture's corner stands for all of it")
        self._put(name, shape.vertices, shape.triangles, uv, index, radiance)

    def add_light(self, name: str, vertices: np.ndarray, triangles: np.ndarray, radiance: np.ndarray) -> None:
        """Add a light that no shape of the file is; it gets a material of its own, which nobody sees."""
        if _LIGHT not in self._index:
            self._index[_LIGHT] = len(self.materials)
            grey, matte, plain = (np.full((1, 1), value, np.float32) for value in (0.5, MATTE, 0.0))
            base = np.repeat(grey[..., None], 3, axis=2)
            self.materials.append(RoomMaterial(self._unique("light", "material"), base, matte, plain))
            self._found.append(None)
        self._put(name, vertices, triangles, np.zeros((len(vertices), 2)), self._index[_LIGHT], radiance)

    def _put(
        self,
        name: str,
        vertices: np.ndarray,
        triangles: np.ndarray,
        uv: np.ndarray,
        index: int,
        radiance: np.ndarray | None,
    ) -> None:
        used, local = np.unique(triangles, return_inverse=True)
        self.surfaces.append(
            SceneShape(
                self._unique(name),
                vertices[used].astype(np.float32),
                local.reshape(-1, 3).astype(np.int32),
                uv[used].astype(np.float32),
                index,
                None if radiance is None else np.asarray(radiance, np.float32),
            )
        )

    def _material(self, bsdf: Node, shape: str, known: ConvertedBsdf) -> int:
        key = _content(bsdf)
        if key not in self._index:
            self._index[key] = len(self.materials)
            name = self._unique(_bsdf_name(bsdf, shape), "material")
            self.materials.append(material(name, known, self.source.settings.smoothest))
            self._found.append(known)
        return self._index[key]

    def _unique(self, name: str, kind: str = "surface") -> str:
        """Return the name, numbered where another has it."""
        number, chosen = 2, name
        while f"{kind} {chosen}" in self._names:
            chosen, number = f"{name}-{number}", number + 1
        self._names.add(f"{kind} {chosen}")
        return chosen

    def scale(self, factor: float) -> None:
        """Change the unit of all surfaces."""
        self.surfaces = [replace(s, vertices=s.vertices * np.float32(factor)) for s in self.surfaces]

    def mesh(self) -> Mesh:
        """Return all surfaces as one mesh."""
        first = np.cumsum([0] + [len(s.vertices) for s in self.surfaces])
        triangles = [s.triangles + offset for s, offset in zip(self.surfaces, first[:-1], strict=True)]
        return Mesh(np.concatenate([s.vertices for s in self.surfaces]), np.concatenate(triangles).astype(np.int32))

    def notes(self) -> list[str]:
        """One line for each material, then what was dropped."""
        lines = [
            described(made, found) for made, found in zip(self.materials, self._found, strict=True) if found is not None
        ]
        for what, count in self._clear.items():
            lines.append(f"dropped {count} shapes of {what}: light passes through")
        if self._slivers:
            lines.append(f"dropped {self._slivers} degenerate triangles")
        return lines


_DEFAULT = Node("bsdf", {"type": "diffuse", "id": "default"}, (), "default")
_LIGHT = "a light that no shape of the file is"


def _content(bsdf: Node) -> str:
    """Return what tells materials apart: all that the file says but the name by which a shape refers to them."""
    return repr(replace(bsdf, attributes={key: text for key, text in bsdf.attributes.items() if key != "name"}))


def _bsdf_name(bsdf: Node, shape: str) -> str:
    """Name of a material: its id or that of what it wraps, else the shape's name."""
    named = (node.id for node in bsdf.walk() if node.tag == "bsdf" and node.id)
    return next(named, f"of {shape}")
