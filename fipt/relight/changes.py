"""What a setup changes beside the light: objects put in, materials edited, segments removed; and spots."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fipt.conventions import SUB_POSITIONS
from fipt.io.background import Background
from fipt.io.cameras import Camera
from fipt.io.fusion import read_fusion
from fipt.io.hits import Hits
from fipt.io.meshes import Mesh
from fipt.io.objects import MeshObject, joined
from fipt.model.networks import Brdf
from fipt.render.edits import Edit, Segments, without
from fipt.render.objects import appended, barycentric, objects_in
from fipt.render.scene import RayScene
from fipt.render.spots import Spot, spots_of
from fipt.render.surface import EmitterSet
from fipt.settings import RelightSetup

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
    """

    edits: Sequence[Edit] = ()
    objects: MeshObject | None = None
    first_object: int = 0
    spots: Sequence[Spot] = ()

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
        return self._edited(found, [edit.holds(points, triangle).astype(np.float32) for edit in self.edits])

    def of_triangles(self) -> Brdf | None:
        """Mean material of every object's triangle, which later vertices of paths have; None without objects."""
        if self.objects is None:
            return None
        triangle = np.arange(len(self.objects.mesh.triangles))
        found = [self.objects.at(triangle, np.tile(w / w.sum(), (len(triangle), 1))) for w in _PLACES]
        return Brdf(*(np.mean(values, axis=0).astype(np.float32) for values in zip(*found, strict=True)))

    def materials(self, found: Brdf, hits: Hits, index: int) -> Brdf:
        """Materials of the first hits of view number ``index``: found ones edited, or those of the objects there."""
        own = hits.of_view(index)
        triangle, position = np.asarray(hits.triangle[own]), np.asarray(hits.position[own])
        if self.edits:
            points = (position[:, None] + np.asarray(hits.sub[own]).astype(np.float32)).reshape(-1, 3)
            wide = np.repeat(triangle, SUB_POSITIONS)
            shares = [edit.holds(points, wide).reshape(-1, SUB_POSITIONS).mean(axis=1) for edit in self.edits]
            found = self._edited(found, [share.astype(np.float32) for share in shares])
        if self.objects is None:
            return found
        there = np.flatnonzero(triangle >= self.first_object)
        number = triangle[there] - self.first_object
        corners = self.objects.mesh.corners[number]
        total = [0.0, 0.0, 0.0]
        for k in range(SUB_POSITIONS):
            point = position[there] + np.asarray(hits.sub[own])[there, k].astype(np.float32)
            layers = self.objects.at(number, barycentric(corners, point))
            total = [sum_ + layer / SUB_POSITIONS for sum_, layer in zip(total, layers, strict=True)]
        arrays = found.base_color.copy(), found.roughness.copy(), found.metallic.copy()
        for array, values in zip(arrays, total, strict=True):
            array[there] = values
        return Brdf(*arrays)

    def smooth(self, hits: Hits, cameras: Sequence[Camera]) -> Hits:
        """Hits with the objects' vertex normals, turned to the viewer."""
        if self.objects is None:
            return hits
        normal = np.asarray(hits.normal).copy()
        for index, camera in enumerate(cameras):
            own = hits.of_view(index)
            there = own.start + np.flatnonzero(np.asarray(hits.triangle[own]) >= self.first_object)
            number, position = np.asarray(hits.triangle)[there] - self.first_object, np.asarray(hits.position)[there]
            weights = barycentric(self.objects.mesh.corners[number], position)
            corner = self.objects.normals[self.objects.mesh.triangles[number]]
            smooth = np.einsum("nk,nkc->nc", weights, corner)
            length = np.linalg.norm(smooth, axis=1, keepdims=True)
            flat = (length[:, 0] < 1e-6) | (~corner.any(axis=2)).any(axis=1)
            smooth = smooth / np.maximum(length, 1e-6)
            smooth *= np.sign((smooth * normal[there]).sum(axis=1, keepdims=True))
            wo = camera.center - position
            wo /= np.linalg.norm(wo, axis=1, keepdims=True)
            lift = np.maximum(_GRAZING - (smooth * wo).sum(axis=1, keepdims=True), 0)
            smooth = smooth + lift * wo
            smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-6)
            normal[there] = np.where(flat[:, None], normal[there], smooth)
        return replace(hits, normal=normal)

    def _edited(self, found: Brdf, shares: Sequence[np.ndarray]) -> Brdf:
        """Materials (N) of which each edit changes a share (N,), in order."""
        color, roughness, metallic = found.base_color, found.roughness, found.metallic
        for edit, share in zip(self.edits, shares, strict=True):
            color = color + share[:, None] * (edit.color(color) - color)
            if edit.change.roughness is not None:
                roughness = roughness + share * (edit.change.roughness - roughness)
            if edit.change.metallic is not None:
                metallic = metallic + share * (edit.change.metallic - metallic)
        return Brdf(*(values.astype(np.float32) for values in (color, roughness, metallic)))


UNCHANGED = Changes()
"""The room as it is."""


def change(
    room: Mesh, mesh: Mesh, lit: EmitterSet, setup: RelightSetup, segments: Path | None, outside: Background
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
        kept = ~gone[lit.triangle]
        lit = EmitterSet(lit.triangle[kept], lit.radiance[kept], lit.two_sided)
    placed = objects_in(mesh, setup.objects, outside.up)
    changes = Changes(
        chosen.edits(setup), joined(placed) if placed else None, len(mesh.triangles), spots_of(setup.lights)
    )
    return appended(mesh, *(thing.mesh for thing in placed)) if placed else mesh, lit, changes
