"""Shapes of a scene file as triangles in its world."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fipt.conventions import FARTHEST
from fipt.errors import FiptError
from fipt.render.assets import LoadedMesh, load_mesh
from fipt.scene.obj import CutFileError, check_whole
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.textures import Map
from fipt.synthetic.scenefile.values import point, transform
from fipt.synthetic.scenefile.xml import Node

AROUND, ALONG = 48, 24
"""Segments around a round shape, and of a sphere from pole to pole."""

_SLIVER = 1e-7
"""Area over the square of the longest side below which a triangle is degenerate."""
_CUTS = 2
"""Times that a triangle is cut in four where a mask is neither clear nor opaque."""
_MIXED = (0.05, 0.95)
_INSIDE = np.array([(i + 1 / 3, j + 1 / 3) for i in range(6) for j in range(6 - i)]) / 6
"""Barycentric coordinates (of two corners) of the points at which a mask is looked up, one in each small triangle."""


@dataclass(frozen=True)
class ShapeGeometry:
    """Triangles of a shape.

    Attributes
    ----------
    vertices
        (V, 3) float64.
    triangles
        (T, 3) int32; light leaves on the side from which their winding is counter-clockwise.
    uv
        (V, 2) float64, or None.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray | None


@dataclass(frozen=True)
class PlacedShape:
    """A shape and where it stands: instances of a group are many of them."""

    node: Node
    to_world: np.ndarray
    name: str


def placed(scene: Node, source: SceneFileReader) -> Iterator[PlacedShape]:
    """Yield the shapes of a scene in order, those of instanced groups in place of the instances."""
    for number, node in enumerate(scene.objects("shape")):
        yield from _placed(node, np.eye(4), node.id or _named(node) or f"{node.type}-{number}", source)


def _named(node: Node) -> str:
    return node.text("filename").replace("\\", "/").rpartition("/")[2].rpartition(".")[0]


def _placed(node: Node, above: np.ndarray, name: str, source: SceneFileReader) -> Iterator[PlacedShape]:
    if node.type == "shapegroup":
        return  # seen through its instances only
    to_world = above @ transform(node.get("to_world"))
    if node.type in ("instance", "merge"):
        groups = [node] if node.type == "merge" else node.objects("shape")
        for group in groups:
            for child in group.objects("shape"):
                yield from _placed(child, to_world, f"{name}/{child.id or _named(child) or child.type}", source)
        return
    if node.type not in _PLUGINS:
        source.refuse(node, f"shape {node.type}")
        return
    yield PlacedShape(node, to_world, name)


def geometry(shape: PlacedShape, source: SceneFileReader) -> ShapeGeometry | None:
    """Return a shape's triangles in the scene's world; None where its file is missing or damaged."""
    mesh = _PLUGINS[shape.node.type](shape, source)
    if mesh is None:
        return None
    linear = shape.to_world[:3, :3]
    vertices = mesh.vertices.astype(np.float64) @ linear.T + shape.to_world[:3, 3]
    if not (np.abs(vertices) <= FARTHEST).all():
        raise shape.node.wrong(f"the vertices of a shape must lie within {FARTHEST:.0e} of the origin")
    triangles = mesh.triangles
    if mesh.normals is not None and not shape.node.flag("face_normals", False):
        # The normals, not the winding, say where the front is; those of a mirrored mesh stay where they were.
        normals = mesh.normals.astype(np.float64) @ np.linalg.pinv(linear)
        a, b, c = np.moveaxis(vertices[triangles], 1, 0)
        backward = (np.cross(b - a, c - a) * normals[triangles].sum(axis=1)).sum(axis=1) < 0
        triangles = np.where(backward[:, None], triangles[:, ::-1], triangles)
    if shape.node.flag("flip_normals", False):
        triangles = triangles[:, ::-1]
    uv = None if mesh.uv is None else np.nan_to_num(mesh.uv.astype(np.float64), posinf=0, neginf=0)
    return ShapeGeometry(vertices, triangles, uv)


def without_slivers(shape: ShapeGeometry) -> ShapeGeometry:
    """Drop degenerate triangles; the order of the others stays."""
    a, b, c = np.moveaxis(shape.vertices[shape.triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.max([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    good = np.isfinite(area) & (area > _SLIVER * longest) & (longest > 0)
    return ShapeGeometry(shape.vertices, shape.triangles[good], shape.uv)


def cut(shape: ShapeGeometry, opacity: Map) -> ShapeGeometry:
    """Leave out what a mask makes clear: triangles less than half of which is opaque, mixed ones first cut smaller."""
    if shape.uv is None or not len(shape.triangles):
        return shape
    corners = np.concatenate([shape.vertices, shape.uv], axis=1)[shape.triangles]  # (T, 3, 5)
    kept: list[np.ndarray] = []
    for round_ in range(_CUTS + 1):
        share = _opaque_share(corners[..., 3:], opacity)
        mixed = (share > _MIXED[0]) & (share < _MIXED[1]) & (round_ < _CUTS)
        kept.append(corners[(share >= 0.5) & ~mixed])
        a, b, c = np.moveaxis(corners[mixed], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])  # (4, 3, M, 5)
        corners = np.moveaxis(corners, 2, 0).reshape(-1, 3, 5)
    found, index = np.unique(np.concatenate(kept).reshape(-1, 5), axis=0, return_inverse=True)
    return ShapeGeometry(found[:, :3], index.reshape(-1, 3).astype(np.int32), found[:, 3:])


def _opaque_share(uv: np.ndarray, opacity: Map) -> np.ndarray:
    """(T,) mean opacity over triangles (T, 3, 2)."""
    if not len(uv):
        return np.zeros(0)
    weights = np.column_stack([1 - _INSIDE.sum(axis=1), _INSIDE])
    points = np.einsum("pc,tcu->tpu", weights, uv)
    place = points @ opacity.from_uv[:, :2].T + opacity.from_uv[:, 2]
    values = opacity.grey
    height, width = values.shape
    rows = np.floor(place[..., 1] * height).astype(np.int64) % height
    columns = np.floor(place[..., 0] * width).astype(np.int64) % width
    return values[rows, columns].mean(axis=1)


# --- plugins --------------------------------------------------------------------------------------------


def _file(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh | None:
    node = shape.node
    path = source.file(node.get("filename"))
    if path is None:
        return None
    options: dict[str, bool | int] = {}
    if node.type == "serialized":
        options["shape_index"] = int(node.number("shape_index", 0))
    flip = node.get("flip_tex_coords")
    if flip is not None:
        options["flip_tex_coords"] = node.flag("flip_tex_coords", False)
    try:
        if node.type == "obj":
            check_whole(path)
        return load_mesh(node.type, path, bool(np.linalg.det(shape.to_world[:3, :3]) < 0), **options)
    except (FiptError, CutFileError) as error:
        source.note(str(error))
        source.refuse(node, f"mesh {path.name}, which cannot be read")
        return None


def _cube(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh:
    return load_mesh("cube")


def _rectangle(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    vertices = np.column_stack([corners, np.zeros(4)])
    return LoadedMesh(vertices, np.array([(0, 1, 2), (0, 2, 3)], np.int32), _facing_z(4), (corners + 1) / 2)


def _disk(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh:
    """Two rings: the inner one is the centre, once for each segment, since u = 0 there at every v."""
    turn = np.arange(AROUND + 1) / AROUND
    rim = np.column_stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn), 0 * turn])
    vertices = np.concatenate([0 * rim, rim])
    uv = np.concatenate([np.column_stack([0 * turn, turn]), np.column_stack([0 * turn + 1, turn])])
    k = np.arange(AROUND)
    triangles = np.column_stack([k, k + AROUND + 1, k + AROUND + 2]).astype(np.int32)
    return LoadedMesh(vertices, triangles, _facing_z(len(vertices)), uv)


def _facing_z(count: int) -> np.ndarray:
    """(count, 3) normals along z: flat shapes face where their normal points, even if they are mirrored."""
    return np.tile((0.0, 0.0, 1.0), (count, 1))


def _sphere(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh:
    center, radius = shape.node.get("center"), _radius(shape.node)
    u, v = np.meshgrid(np.arange(AROUND + 1) / AROUND, np.arange(ALONG + 1) / ALONG)
    theta, phi = np.pi * v.ravel(), 2 * np.pi * u.ravel()
    normals = np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    vertices = normals * radius + (0.0 if center is None else point(center))
    return LoadedMesh(vertices, _grid(ALONG, AROUND), normals, np.column_stack([u.ravel(), v.ravel()]))


def _cylinder(shape: PlacedShape, source: SceneFileReader) -> LoadedMesh:
    node = shape.node
    ends = zip((node.get("p0"), node.get("p1")), ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), strict=True)
    p0, p1 = (np.array(default) if found is None else point(found) for found, default in ends)
    if (p0 == p1).all():
        raise node.wrong("the ends of a cylinder must be apart")
    x, y, z = axis = (p1 - p0) / np.linalg.norm(p1 - p0)
    # Where u begins: the frame around a direction of Duff et al. (JCGT 2017), which Mitsuba uses.
    sign = np.copysign(1.0, z)
    side = np.array((1 - sign * x * x / (sign + z), -sign * x * y / (sign + z), -sign * x))
    u, v = np.meshgrid(np.arange(AROUND + 1) / AROUND, (0.0, 1.0))
    phi = 2 * np.pi * u.ravel()[:, None]
    normals = np.cos(phi) * side + np.sin(phi) * np.cross(axis, side)
    vertices = p0 + v.ravel()[:, None] * (p1 - p0) + normals * _radius(node)
    return LoadedMesh(vertices, _grid(1, AROUND), normals, np.column_stack([u.ravel(), v.ravel()]))


def _radius(node: Node) -> float:
    radius = node.number("radius", 1.0)
    if radius <= 0:
        raise node.wrong(f"the radius of a {node.type} must be above 0; found {radius:g}")
    return radius


def _grid(rows: int, columns: int) -> np.ndarray:
    """(2 rows columns, 3) int32 triangles of a grid of (rows + 1) x (columns + 1) vertices."""
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    upper = np.column_stack([corner, below, below + 1])
    return np.stack([upper, np.column_stack([corner, below + 1, corner + 1])], axis=1).reshape(-1, 3).astype(np.int32)


_PLUGINS: dict[str, Callable[[PlacedShape, SceneFileReader], LoadedMesh | None]] = {
    **dict.fromkeys(("obj", "ply", "serialized"), _file),
    "cube": _cube,
    "rectangle": _rectangle,
    "disk": _disk,
    "sphere": _sphere,
    "cylinder": _cylinder,
}
