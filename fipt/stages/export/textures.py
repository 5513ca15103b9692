"""Textures of the surface: the networks asked over every texel, emitters, confidence."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.formats.images import to_display
from fipt.meshing.atlas import Atlas, AtlasTexels, filled, nearest_weights
from fipt.model.networks import Brdf, Field
from fipt.progress import progress
from fipt.scene.asset import MaterialTextures
from fipt.scene.confidence import Confidence
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.samples import FootprintSamples, summed_by
from fipt.scene.voxels import voxel_keys

_CHUNK = 1 << 17
"""Texels asked at once."""
_VOXELS = 64
"""Along the scene box: how finely the pixels' size over the surface is known."""


@dataclass(frozen=True)
class Coverage:
    """How large the pixels of the training views are on the surface: a mean by voxel of the scene box.

    Attributes
    ----------
    footprint
        (_VOXELS ** 3,) float32 metres; the median of all where no view looks.
    typical
        The finest quarter of all pixels are at most so large, metres.
    normals
        (T, 3) float32 normals of the triangles, turned to where most pixels see them from; those that no pixel shows
        are wound as the nearest that one does.
    """

    footprint: np.ndarray
    typical: float
    normals: np.ndarray


def coverage(field: Field, mesh: Mesh, shards: Sequence[FootprintSamples]) -> Coverage:
    """Pixel size over the surface, and its seen sides, from the footprint samples of the training views."""
    keys = [_voxels(field, np.asarray(samples.position)) for samples in shards]
    sizes = [np.asarray(samples.footprint, np.float64) for samples in shards]
    total = summed_by(zip(keys, sizes, strict=True), _VOXELS**3)
    count = np.bincount(np.concatenate(keys), minlength=_VOXELS**3)
    every = np.concatenate(sizes)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.median(every))
    return Coverage(mean.astype(np.float32), float(np.quantile(every, 0.25)), _seen_normals(mesh, shards))


def _seen_normals(mesh: Mesh, shards: Sequence[FootprintSamples]) -> np.ndarray:
    """(T, 3) normals of the triangles, turned to their viewers."""
    front, shown = np.zeros((2, len(mesh.triangles)))
    for samples in shards:
        triangle = np.asarray(samples.triangle)
        facing = (np.asarray(samples.normal) * mesh.normals[triangle]).sum(axis=1)
        front += np.bincount(triangle, np.sign(facing), len(front))
        shown += np.bincount(triangle, minlength=len(front))
    side, hidden = np.where(front < 0, -1, 1).astype(np.float32), shown == 0
    if hidden.any() and not hidden.all():
        centers = mesh.corners.mean(axis=1)
        nearest = cKDTree(centers[~hidden]).query(centers[hidden], workers=-1)[1]
        side[hidden] = side[~hidden][nearest]
    return side[:, None] * mesh.normals


def _voxels(field: Field, points: np.ndarray) -> np.ndarray:
    return voxel_keys(points, np.asarray(field.box.center), field.box.side, _VOXELS)


def surface_brdf(
    field: Field, mesh: Mesh, atlas: Atlas, known: AtlasTexels, seen: Coverage, samples: int, scale: float
) -> Brdf:
    """Reflectance of every known texel: the mean of the networks' answers over it.

    Queries are as wide as a pixel of the training views is there, or as a texel where that is more: finer detail has
    been taught by no image.

    Parameters
    ----------
    samples
        A texel is asked at the square of this many points.
    scale
        Size of a query in footprints, as the fit used it.
    """
    corners = mesh.corners.astype(np.float64)
    flat = atlas.uv[atlas.triangles].astype(np.float64) * [atlas.width, atlas.height]
    steps = (np.arange(samples) + 0.5) / samples
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    count, points = len(known.index), len(offsets)
    values = np.empty((count, 5), np.float32)
    with progress("textures", count * points, " queries") as bar:
        for start in range(0, count, _CHUNK):
            part = slice(start, min(start + _CHUNK, count))
            texel, triangle = known.index[part], known.triangle[part]
            corner = np.stack([texel % atlas.width, texel // atlas.width], axis=1)
            point = (corner[:, None] + offsets).reshape(-1, 2)
            owner = np.repeat(triangle, points)
            weights, _ = nearest_weights(flat[owner], point)
            p_world = np.einsum("nk,nkd->nd", weights, corners[owner])
            footprint = np.maximum(seen.footprint[_voxels(field, p_world)], 1 / atlas.density)
            place = field.place(p_world, seen.normals[owner])
            brdf = field.query(place, (scale * footprint).astype(np.float32))
            stacked = np.column_stack([brdf.base_color, brdf.roughness, brdf.metallic])
            values[part] = stacked.reshape(-1, points, 5).mean(axis=1)
            bar.advance(len(owner))
    return Brdf(values[:, :3], values[:, 3], values[:, 4])


def surface_textures(brdf: Brdf, emitters: Emitters, atlas: Atlas, known: AtlasTexels) -> MaterialTextures:
    """Materials of the whole atlas; emitters are black and matte, as they are in our images."""
    emitting = np.isin(known.triangle, emitters.triangle)
    color = to_display(np.where(emitting[:, None], 0, brdf.base_color))
    rough, metal = np.where(emitting, 1, brdf.roughness), np.where(emitting, 0, brdf.metallic)
    size = atlas.height, atlas.width
    return MaterialTextures(
        filled(color, known, *size), filled(_in_bytes(rough), known, *size), filled(_in_bytes(metal), known, *size)
    )


def emission_texture(emitters: Emitters, atlas: Atlas, known: AtlasTexels) -> np.ndarray:
    """(h, w, 3) float32 radiance that the surface emits."""
    radiance = np.zeros((len(atlas.triangles), 3), np.float32)
    radiance[emitters.triangle] = emitters.radiance
    return filled(radiance[known.triangle], known, atlas.height, atlas.width)


def confidence_texture(confidence: Confidence, mesh: Mesh, atlas: Atlas, known: AtlasTexels) -> np.ndarray:
    """(h, w) uint8 confidence in the material, of the better seen side; 255 is 1."""
    p_world = np.einsum("nk,nkd->nd", known.weights, mesh.corners[known.triangle])
    normal = mesh.normals[known.triangle]
    values = [confidence.at(p_world, side * normal, confidence.combined) for side in (1, -1)]
    return filled(_in_bytes(np.maximum(*values)), known, atlas.height, atlas.width)


def _in_bytes(values: np.ndarray) -> np.ndarray:
    return (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)
