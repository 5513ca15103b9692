"""Groups of triangles that share a material, and what was found of them as a model and emitters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.model.parts import PartLabels, PartMaterials, centre_samples
from fipt.model.reflectance import Brdf
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.samples import FootprintSamples


@dataclass(frozen=True)
class PartGroups:
    """Parts as groups without gaps.

    Attributes
    ----------
    segment
        (G,) segment id of each group, 0 for triangles of which none is known.
    of_triangle
        (T,) group of each triangle.
    """

    segment: np.ndarray
    of_triangle: np.ndarray

    @classmethod
    def of(cls, labels: PartLabels) -> "PartGroups":
        """Groups of a room's parts."""
        segment, group = np.unique(labels.of_triangle, return_inverse=True)
        return cls(segment, group.reshape(-1))

    def materials(self, labels: PartLabels, values: dict[str, np.ndarray]) -> PartMaterials:
        """A model whose rows are segment ids; ids without a triangle have the mean."""
        rows = {}
        for name in ("base_color", "roughness", "metallic"):
            own = values[name].astype(np.float32)
            rows[name] = np.repeat(own.mean(axis=0, keepdims=True), labels.count, axis=0)
            rows[name][self.segment] = own
        return PartMaterials(labels, Brdf(rows["base_color"], rows["roughness"], rows["metallic"]))

    def emitters(self, mesh: Mesh, emits: np.ndarray, radiance: np.ndarray) -> Emitters:
        """Emitters of groups (G,) bool with their radiance (G, 3)."""
        triangle = np.flatnonzero(emits[self.of_triangle])
        group = self.of_triangle[triangle]
        return Emitters.plain(mesh, triangle, radiance[group], group) if len(triangle) else Emitters.none()


def facing_viewers(mesh: Mesh, shards: Sequence[FootprintSamples]) -> Mesh:
    """The mesh with triangles turned that views show from their back: Mitsuba's emitters have one side."""
    votes = np.zeros(len(mesh.triangles))
    for shard in shards:
        _, first = centre_samples(shard)
        triangle = np.asarray(shard.triangle)[first]
        side = np.sign((mesh.normals[triangle] * np.asarray(shard.normal)[first]).sum(axis=1))
        votes += np.bincount(triangle, side, len(votes))
    triangles = np.where((votes < 0)[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    return Mesh(mesh.vertices, triangles.astype(np.int32))


def seen_radiance(
    groups: PartGroups, shards: Sequence[FootprintSamples], pixels: Sequence[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """(G,) median over the channels' mean radiance of the pixels with weight that show each group; 0 where none does.

    ``pixels`` are radiance (P, 3) and weight (P,) of each shard.
    """
    level, group = [], []
    for shard, (radiance, weight) in zip(shards, pixels, strict=True):
        pixel, first = centre_samples(shard)
        counted = weight[pixel] > 0
        group.append(groups.of_triangle[np.asarray(shard.triangle)[first[counted]]])
        level.append(radiance[pixel[counted]].mean(axis=1))
    level, group = np.concatenate(level), np.concatenate(group)
    order = np.argsort(group, kind="stable")
    found = np.zeros(len(groups.segment))
    for own in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        if len(own):
            found[group[own[0]]] = np.median(level[own])
    return found
