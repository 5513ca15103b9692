"""Triangle meshes: read, check, write. Triangle order is kept: ids elsewhere refer to it."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import FARTHEST
from fipt.errors import FiptError, unreadable
from fipt.formats.files import atomic, existing_file
from fipt.groups import connected_groups
from fipt.scene.obj import read_obj
from fipt.scene.voxels import facings

_FACE = [("count", "u1"), ("indices", "<i4", 3)]
_OWN_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\nelement vertex (\d+)\n"
    rb"property float x\nproperty float y\nproperty float z\n"
    rb"(property uchar red\nproperty uchar green\nproperty uchar blue\n)?"
    rb"element face (\d+)\nproperty list uchar int vertex_indices\nend_header\n"
)
_LONGEST_HEADER = 400
"""Bytes; counts of twenty digits fit in."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in metres.

    Attributes
    ----------
    vertices
        (V, 3) float32 positions.
    triangles
        (T, 3) int32 vertex indices.
    seen_from
        (N, 3) float64 places where cameras stand, metres: what is far from all that they see does not set the scale.
        None: nothing is known of them.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    seen_from: np.ndarray | None = None

    @property
    def corners(self) -> np.ndarray:
        """(T, 3, 3) float32 corner positions of every triangle."""
        return self.vertices[self.triangles]

    @property
    def area_normals(self) -> np.ndarray:
        """(T, 3) float64 geometric normals; their length is the triangle's area in square metres."""
        a, b, c = np.moveaxis(self.corners.astype(np.float64), 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def areas(self) -> np.ndarray:
        """(T,) float64 areas in square metres."""
        return np.linalg.norm(self.area_normals, axis=1)

    @property
    def normals(self) -> np.ndarray:
        """(T, 3) float32 unit geometric normals by winding order; zero for degenerate triangles."""
        n = self.area_normals
        length = np.linalg.norm(n, axis=1, keepdims=True)
        return (n / np.where(length > 0, length, 1.0)).astype(np.float32)

    def front(self, triangle: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(N,) bool: whether directions (N, 3) leave triangles (N,) from the side that their winding faces."""
        return (direction * Mesh(self.vertices, self.triangles[triangle]).normals).sum(axis=1) > 0


def read_mesh(path: str | Path) -> Mesh:
    """Read a PLY or OBJ mesh, all objects merged, vertices and triangles in file order.

    Raises
    ------
    FiptError
        If the file is missing, empty, not a mesh, has NaN vertices or indices out of range.
    """
    vertices, triangles = read_geometry(path)
    return Mesh(vertices.astype(np.float32), triangles)


def read_geometry(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a mesh as `read_mesh` does: (V, 3) float64 vertices, which may lie far from the origin, (T, 3) int32."""
    path = existing_file(path, "the mesh")
    try:
        read = read_obj if path.suffix.lower() == ".obj" else _read_other
        own = _read_own(path) if path.suffix.lower() == ".ply" else None
        vertices, triangles = own or read(path)
    except Exception as error:  # trimesh raises whatever its parsers raise
        remedy = "give a PLY or OBJ file with triangles"
        raise unreadable(path, error, f"is not a readable mesh ({error})", remedy) from error
    if len(triangles) == 0 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise FiptError(
            f"the mesh {path} must hold triangles; it has none",
            "give a PLY or OBJ file with triangles",
        )
    bad = ~(np.abs(vertices) <= np.finfo(np.float32).max).all(axis=1)
    if bad.any():
        raise FiptError(
            f"the mesh {path} must have finite vertices; {int(bad.sum())} are NaN or infinite, the first is "
            f"vertex {int(np.argmax(bad))}",
            "repair the mesh",
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise FiptError(f"the mesh {path} refers to vertices it does not have", "repair the mesh")
    used = np.unique(triangles)
    far = used[(np.abs(vertices[used]) > FARTHEST).any(axis=1)]
    if len(far):
        raise FiptError(
            f"the vertices of {path} must lie within {FARTHEST:.0e} of the origin; {len(far)} do not, the first is "
            f"vertex {far[0]}",
            "repair the mesh",
        )
    return vertices, triangles


def connected_parts(mesh: Mesh) -> np.ndarray:
    """(T,) int32 number of the connected component of each triangle; vertices at one place count as one."""
    _, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = vertex.reshape(-1)[mesh.triangles]
    rows, columns = corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()
    count = int(corners.max()) + 1
    return connected_groups((rows, columns), count)[corners[:, 0]].astype(np.int32)


def touching_triangles(mesh: Mesh) -> np.ndarray:
    """(2, N) pairs of triangles that share an edge; vertices at one place count as one."""
    _, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corner = vertex.reshape(-1)[mesh.triangles].astype(np.int64)
    edge = np.sort(corner[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = edge[:, 0] * (int(corner.max(initial=0)) + 1) + edge[:, 1]
    order = np.argsort(key, kind="stable")
    owner = np.repeat(np.arange(len(corner)), 3)[order]
    same = key[order][1:] == key[order][:-1]
    return np.stack([owner[:-1][same], owner[1:][same]])


def facing_pieces(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """(T,) int64 number of the connected surface of chosen triangles (T,) bool that faces along one axis.

    Both sides of a sheet are one piece. A triangle that is not chosen is a piece by itself.
    """
    axis = facings(mesh.area_normals) // 2
    a, b = touching_triangles(mesh)
    joined = chosen[a] & chosen[b] & (axis[a] == axis[b])
    return connected_groups((a[joined], b[joined]), len(axis))


def closed(mesh: Mesh) -> bool:
    """Whether each edge belongs to two triangles, so that nobody sees the inside."""
    # corners that a hundredth of a millimetre parts are one
    _, vertex = np.unique(mesh.vertices.round(5), axis=0, return_inverse=True)
    corner = vertex.reshape(-1)[mesh.triangles]
    edges = np.sort(corner[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def point_counts(mesh: Mesh, spacing: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(T,) int64 points that `surface_points` tries on each triangle."""
    corners = mesh.corners
    inside = (corners.max(axis=1) > low).all(axis=1) & (corners.min(axis=1) < high).all(axis=1)
    areas = np.where(inside, mesh.areas, 0.0)
    # a huge triangle may reach far out of the box: cap its points; those inside are kept
    return np.where(inside, 1 + np.minimum(areas / spacing**2, 4e6), 0).astype(np.int64)


def points_of(corners: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Points of triangles: uniform over them for uniform random numbers (Osada et al. 2002, Sec. 3.1).

    Parameters
    ----------
    corners
        (..., 3, 3) vertices of each triangle, metres.
    u, v
        (...) in [0, 1).

    Returns
    -------
    np.ndarray
        (..., 3) metres, of the widest float type that is given.
    """
    root, v = np.sqrt(u)[..., None], v[..., None]
    a, b, c = np.moveaxis(corners, -2, 0)
    return a * (1 - root) + b * (root * (1 - v)) + c * (root * v)


def surface_points(
    mesh: Mesh, spacing: float, low: np.ndarray, high: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points on the mesh inside a box, about one per ``spacing`` squared and at least one a triangle.

    Returns
    -------
    points
        (N, 3) float32, metres.
    triangle
        (N,) int64 index of the triangle of each.
    """
    corners, counts = mesh.corners, point_counts(mesh, spacing, low, high)
    owner = np.repeat(np.arange(len(counts)), counts)
    u = np.random.default_rng(seed).random((len(owner), 2), dtype=np.float32)
    points = points_of(corners[owner], u[:, 0], u[:, 1])
    keep = ((points > low) & (points < high)).all(axis=1)
    return points[keep].astype(np.float32), owner[keep]


def face_property(path: str | Path, name: str) -> np.ndarray:
    """(T,) values of a scalar property of a PLY's faces.

    Raises
    ------
    FiptError
        If the file is missing, not a PLY of triangles, or has no such property.
    """
    import trimesh

    existing_file(path, "the labelled mesh")
    try:
        loaded = trimesh.load(path, process=False, maintain_order=True, force="mesh", file_type="ply")
        faces = loaded.metadata["_ply_raw"]["face"]["data"]
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise FiptError(f"{path} is not a readable PLY mesh ({error})", "give a PLY file with triangles") from error
    names = faces.dtype.names if isinstance(faces, np.ndarray) else tuple(faces)
    if name not in names:
        raise FiptError(
            f"the faces of {path} have no property {name!r}; found {', '.join(names)}", "name it with segment.property"
        )
    return np.asarray(faces[name]).reshape(-1)


def _read_own(path: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Read what `write_ply` wrote; None of any other file, for which trimesh is worth its second of import."""
    with open(path, "rb") as file:
        header = _OWN_HEADER.match(file.read(_LONGEST_HEADER))
        if header is None:
            return None
        file.seek(header.end())
        content = file.read()
    vertex = np.dtype(_vertex_fields(header[2] is not None))
    count, faces = int(header[1]), int(header[3])
    found = len(content) - count * vertex.itemsize
    if found != faces * np.dtype(_FACE).itemsize:
        return None
    vertices = np.frombuffer(content, vertex, count)
    triangles = np.frombuffer(content, _FACE, faces, count * vertex.itemsize)
    if (triangles["count"] != 3).any():
        return None
    return np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64), triangles["indices"].copy()


def _read_other(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    if path.suffix.lower() == ".ply":
        _check_ascii_ply(path)
    loaded: Any = trimesh.load(path, process=False, maintain_order=True, force="mesh")
    return np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int32)


def _check_ascii_ply(path: Path) -> None:
    """Raise ValueError where a PLY file of text has not the lines that its header announces: trimesh takes what is."""
    with open(path, "rb") as file:
        text, announced = False, 0
        for words in map(bytes.split, file):
            text = text or words[:2] == [b"format", b"ascii"]
            announced += int(words[2]) if words[:1] == [b"element"] else 0
            if words == [b"end_header"]:
                break
        found = sum(1 for line in file if line.strip()) if text else announced
    if found != announced:
        raise ValueError(f"its header announces {announced} lines, {found} follow")


def write_ply(path: str | Path, mesh: Mesh, colors: np.ndarray | None = None) -> None:
    """Write a binary PLY file, vertices and triangles in order.

    Parameters
    ----------
    colors
        Optional (V, 3) uint8 vertex colours.
    """
    vertex_fields = _vertex_fields(colors is not None)
    vertices = np.zeros(len(mesh.vertices), vertex_fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = mesh.vertices[:, axis]
    if colors is not None:
        for axis, name in enumerate(("red", "green", "blue")):
            vertices[name] = colors[:, axis]
    faces = np.zeros(len(mesh.triangles), _FACE)
    faces["count"] = 3
    faces["indices"] = mesh.triangles
    types = {"<f4": "float", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property {types[kind]} {name}" for name, kind in vertex_fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with atomic(path) as temporary, open(temporary, "wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def _vertex_fields(colored: bool) -> list[tuple[str, str]]:
    """Fields of a vertex in a file of ours."""
    colors = [("red", "u1"), ("green", "u1"), ("blue", "u1")] if colored else []
    return [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), *colors]
