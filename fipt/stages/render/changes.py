"""What a setup changes beside the light: objects put in, materials edited, segments removed; and spots."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fipt.model.networks import Brdf
from fipt.render.edits import Edit, Segments, without
from fipt.render.image import SurfaceInteractions
from fipt.render.objects import appended, barycentric, objects_in
from fipt.render.scene import RayScene
from fipt.render.spots import Spot, spots_of
from fipt.render.surface import EmitterSet
from fipt.scene.environment import EnvironmentMap
from fipt.scene.fusion import read_fusion
from fipt.scene.mesh import Mesh
from fipt.scene.objects import MeshObject, joined
from fipt.scene.setup import RelightSetup

_PLACES = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 0], [0, 2, 2], [2, 0, 2], [1, 1, 1]], float)
"""Barycentric places of a triangle over which its material is averaged for later vertices of paths."""
_GRAZING = 0.02
"""Least cosine between the smooth normal of a first hit and the direction to the viewer."""


@dataclass(frozen=True)
class Changes:
    """What a setup changes beside the light.

    Attributes
    ----------
    edits
        Other materials, in order.
    objects
        What is put in: the last triangles of the mesh; None: nothing.
    first_object
        Number of the first of these triangles.
    spots
        Lights at points.
    counts
        Triangles of each object, in order.
    """

    edits: Sequence[Edit] = ()
    objects: MeshObject | None = None
    first_object: int = 0
    spots: Sequence[Spot] = ()
    counts: Sequence[int] = ()

    def records(self, found: Brdf, points: np.ndarray, facing: np.ndarray, scene: RayScene) -> Brdf:
        """Materials of the K voxel records after the edits.

        Parameters
        ----------
        points, facing
            (K, 3) and (K,) of cache.npz: a point of the surface, and the way it faces.
        """
        if not self.edits:
            return found
        triangle = np.full(len(points), -1)
        if any(isinstance(edit.where, np.ndarray) for edit in self.edits):
            out = np.zeros_like(points)
            out[np.arange(len(points)), facing // 2] = np.where(facing % 2 == 1, 1.0, -1.0)
            triangle = scene.intersect(points + scene.epsilon * out, -out)[1]
        return self._edited(found, [edit.holds(points, triangle) for edit in self.edits])

    def of_triangles(self) -> Brdf | None:
        """Mean material of every object's triangle, which later vertices of paths have; None without objects."""
        if self.objects is None:
            return None
        triangle = np.arange(len(self.objects.mesh.triangles))
        found = [self.objects.at(triangle, np.tile(w / w.sum(), (len(triangle), 1))) for w in _PLACES]
        return Brdf(*(np.mean(values, axis=0).astype(np.float32) for values in zip(*found, strict=True)))

    def materials(self, found: Brdf, si: SurfaceInteractions) -> Brdf:
        """Materials of footprint samples: found ones edited, or those of the objects there."""
        found = self._edited(found, [edit.holds(si.position, si.triangle) for edit in self.edits])
        there = self._objects_in(si)
        if self.objects is None or len(there) == 0:
            return found
        number = si.triangle[there] - self.first_object
        own = self.objects.at(number, barycentric(self.objects.mesh.corners[number], si.position[there]))
        arrays = found.base_color.copy(), found.roughness.copy(), found.metallic.copy()
        for array, values in zip(arrays, own, strict=True):
            array[there] = values
        return Brdf(*arrays)

    def smooth(self, si: SurfaceInteractions) -> SurfaceInteractions:
        """Footprint samples with the objects' vertex normals, turned to the viewer."""
        there = self._objects_in(si)
        if self.objects is None or len(there) == 0:
            return si
        number, wo = si.triangle[there] - self.first_object, si.wo[there]
        weights = barycentric(self.objects.mesh.corners[number], si.position[there])
        corner = self.objects.normals[self.objects.mesh.triangles[number]]
        smooth = np.einsum("nk,nkc->nc", weights, corner)
        length = np.linalg.norm(smooth, axis=1, keepdims=True)
        flat = (length[:, 0] < 1e-6) | np.any(~np.any(corner, axis=2), axis=1)
        smooth = smooth / np.maximum(length, 1e-6)
        smooth *= np.sign((smooth * si.normal[there]).sum(axis=1, keepdims=True))
        smooth = smooth + np.maximum(_GRAZING - (smooth * wo).sum(axis=1, keepdims=True), 0) * wo
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-6)
        normal = si.normal.copy()
        normal[there] = np.where(flat[:, None], normal[there], smooth)
        return replace(si, normal=normal)

    def _objects_in(self, si: SurfaceInteractions) -> np.ndarray:
        """Numbers of the footprint samples that lie on objects."""
        return np.flatnonzero(si.triangle >= self.first_object) if self.objects is not None else np.empty(0, int)

    def _edited(self, found: Brdf, holds: Sequence[np.ndarray]) -> Brdf:
        """Materials (N) that each edit changes where it ``holds`` (N,) bool, in order."""
        color, roughness, metallic = found.base_color, found.roughness, found.metallic
        for edit, there in zip(self.edits, holds, strict=True):
            color = np.where(there[:, None], edit.color(color), color)
            if edit.change.roughness is not None:
                roughness = np.where(there, edit.change.roughness, roughness)
            if edit.change.metallic is not None:
                metallic = np.where(there, edit.change.metallic, metallic)
        return Brdf(*(values.astype(np.float32) for values in (color, roughness, metallic)))


UNCHANGED = Changes()
"""The room as it is."""


def change(
    room: Mesh, mesh: Mesh, lit: EmitterSet, setup: RelightSetup, segments: Path | None, outside: EnvironmentMap
) -> tuple[Mesh, EmitterSet, Changes]:
    """Take out what a setup removes, and put in what it adds.

    Parameters
    ----------
    room
        The mesh as it was.
    mesh, lit
        With the new lights.
    segments
        fusion.npz, whose ids setups use; None: the connected parts of the room.
    outside
        Knows which way is up.

    Returns
    -------
    mesh
        The objects' triangles are its last ones; the room's keep their numbers.
    lit
        What still shines.
    changes
        What else there is to know.
    """
    ids = None if segments is None else read_fusion(segments)[0].part
    chosen = Segments(room, ids, outside.up)
    gone = np.zeros(len(mesh.triangles), bool)
    gone[: len(room.triangles)] = chosen.removed(setup)
    if gone.any():
        mesh = without(mesh, gone)
        lit = lit.chosen(~gone[lit.triangle])
    placed = objects_in(mesh, setup.objects, outside.up)
    changes = Changes(
        chosen.edits(setup),
        joined(placed) if placed else None,
        len(mesh.triangles),
        spots_of(setup.lights),
        [len(thing.mesh.triangles) for thing in placed],
    )
    return appended(mesh, *(thing.mesh for thing in placed)) if placed else mesh, lit, changes
