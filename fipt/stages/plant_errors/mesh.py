"""Errors of a mesh: noise, a front that is moved, parts that are missing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED
from fipt.scene.mesh import Mesh

_ALIKE = 0.97
"""Cosine of normals that belong to one front."""


@dataclass(frozen=True)
class NamedParts:
    """Triangles of the parts of a room in code.

    Attributes
    ----------
    names
        Of the parts.
    of_triangle
        (T,) index into the names.
    """

    names: Sequence[str]
    of_triangle: np.ndarray

    @classmethod
    def of(cls, room: dict, mesh: Mesh) -> "NamedParts":
        """Parts as room.json lists them, in the order of their triangles.

        Raises
        ------
        FiptError
            If it lists none, or those of another mesh.
        """
        try:
            names = [str(part["name"]) for part in room["parts"]]
            counts = [int(part["triangles"]) for part in room["parts"]]
        except MALFORMED as error:
            raise FiptError(f"room.json must list its parts and their triangles ({error!r})", OTHERS) from error
        if sum(counts) != len(mesh.triangles):
            raise FiptError(
                f"room.json must be of the same mesh; it lists {sum(counts)} triangles, mesh.ply has "
                f"{len(mesh.triangles)}",
                OTHERS,
            )
        return cls(names, np.repeat(np.arange(len(names)), counts))

    def chosen(self, wanted: Sequence[str], key: str) -> np.ndarray:
        """(T,) bool: triangles of some parts.

        Raises
        ------
        FiptError
            If there is no such part.
        """
        for name in wanted:
            if name not in self.names:
                raise FiptError(f"plant_errors.{key}: there is no part {name!r}", f"parts: {', '.join(self.names)}")
        return np.isin(self.of_triangle, [self.names.index(name) for name in wanted])


OTHERS = "plant errors of parts in rooms in code only"


def noisy(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Mesh:
    """The mesh with normally distributed noise on every vertex, metres."""
    noise = rng.normal(0, deviation, mesh.vertices.shape)
    return Mesh((mesh.vertices + noise).astype(np.float32), mesh.triangles)


def front_of(mesh: Mesh, part: np.ndarray, viewers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The front of a part: (T,) bool triangles, and its unit normal (3,).

    The front is the largest area of one upright direction, as much as it faces where cameras stand.

    Parameters
    ----------
    part
        (T,) bool.
    viewers
        (3,) where cameras stand, metres.
    """
    areas, normals = mesh.areas * part, mesh.normals
    middle = (mesh.corners.mean(axis=1) * areas[:, None]).sum(axis=0) / max(areas.sum(), 1e-12)
    toward = viewers - middle
    toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
    own = np.flatnonzero(part)
    tried = own[np.argsort(-areas[own])[:256]]
    alike = normals[tried] @ normals.T > _ALIKE
    score = (alike * areas).sum(axis=1) * (normals[tried] @ toward) * (np.abs(normals[tried, 1]) < 1 - _ALIKE)
    normal = normals[tried[int(np.argmax(score))]]
    return part & (normals @ normal > _ALIKE), normal


def moved(mesh: Mesh, front: np.ndarray, shift: np.ndarray) -> Mesh:
    """The mesh with the vertices of some triangles (T,) moved by (3,) metres; what adjoins them is stretched."""
    vertices = mesh.vertices.copy()
    places = np.unique(mesh.vertices[np.unique(mesh.triangles[front])], axis=0)
    at_front = {place.tobytes() for place in places}
    same = np.fromiter((vertex.tobytes() in at_front for vertex in mesh.vertices), bool, len(vertices))
    vertices[same] += shift.astype(np.float32)
    return Mesh(vertices, mesh.triangles)


def without(mesh: Mesh, removed: np.ndarray) -> Mesh:
    """The mesh without some triangles (T,)."""
    return Mesh(mesh.vertices, mesh.triangles[~removed])
