"""What mirrors show is not unseen: how bright surface is at most that views see by way of a mirror."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

from fipt.model.parts import MaterialModel, seen_materials
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.scene.voxels import facings

_SMOOTH = 0.15
"""Roughness up to which a metal is a mirror."""
_MOST = 1 << 21
"""Pixels that the model is asked about, those of views spread evenly over all: seconds."""
_FLAT = 16
"""Pixels in one plane of a view that a mirror has at least: a curved one shows what its noisy normals make of it."""
_STEP, _DEPTH = 1 / 64, 0.01
"""Steps of the normal, and metres along it, by which planes are told."""
_DARK = 0.05
"""Base colour below which a mirror shows too little."""


@dataclass(frozen=True)
class _Pixels:
    """N pixels of mirrors, what `FootprintSamples` has of the piece of surface that fills each, and what it shows.

    Attributes
    ----------
    toward
        (N, 3) metres from the camera to the piece.
    shown
        (N,) radiance of what is mirrored, the mean of the channels.
    """

    toward: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    footprint: np.ndarray
    shown: np.ndarray


def shown_by_mirrors(mesh: Mesh, data: Dataset, shards: Sequence[ObservedShard], model: MaterialModel) -> np.ndarray:
    """Radiance that triangles have at most, as mirrors show them to the training views.

    What is metal, smooth and flat is a mirror, but for the pixels along its border: they may hold some of a lamp beside
    it. It shows a triangle if one of its rays ends there, or within two widths of its pixel from the triangle's centre,
    on surface that faces the same way.

    Parameters
    ----------
    model
        The materials of the round before.

    Returns
    -------
    (T,) float64, the mean of the channels; inf where no mirror shows a triangle.
    """
    of_views = [(shard, index) for shard in shards for index in range(len(shard.samples.views))]
    pixels = sum(len(shard.radiance) for shard in shards)
    found = [_mirrors(data, shard, index, model) for shard, index in of_views[:: max(-(-pixels // _MOST), 1)]]
    mirrors = _Pixels(*(np.concatenate(column) for column in zip(*(astuple(each) for each in found), strict=True)))
    if len(mirrors.shown) == 0:  # Dr.Jit traces no empty bundle
        return np.full(len(mesh.triangles), np.inf)
    return _at_most(mesh, *_mirrored(RayScene(mesh), mirrors))


def _mirrors(data: Dataset, shard: ObservedShard, index: int, model: MaterialModel) -> _Pixels:
    """Pixels of mirrors in a view."""
    samples = shard.samples
    own, pixel, first = samples.of_view(index), samples.pixel_of_sample(index), samples.pixels(index).start
    use = (samples.weight[own] >= ALONE) & (shard.weight[first + pixel] > 0) & ~shard.clipped[first + pixel]
    rows, pixel = np.flatnonzero(use) + own.start, pixel[use]
    position, normal = np.asarray(samples.position[rows]), np.asarray(samples.normal[rows])
    footprint, triangle = np.asarray(samples.footprint[rows]), np.asarray(samples.triangle[rows])
    brdf = seen_materials(model, position, normal, footprint, triangle)
    base = np.asarray(brdf.base_color, np.float64)
    smooth = np.zeros(samples.shapes[index], bool)
    smooth.flat[pixel] = (brdf.metallic > 0.5) & (brdf.roughness <= _SMOOTH) & (base.min(axis=1) > _DARK)
    inner = binary_erosion(smooth, np.ones((3, 3), bool)).ravel()[pixel]
    inner[inner] = _in_large_planes(position[inner], normal[inner])
    toward = position[inner] - data.camera(samples.views[index]).center.astype(np.float32)
    shown = (shard.radiance[first + pixel[inner]] / base[inner]).mean(axis=1)
    return _Pixels(toward, position[inner], normal[inner], footprint[inner], shown)


def _in_large_planes(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N,) bool: which of some pixels are in planes that have `_FLAT` of them."""
    along = (position * normal).sum(axis=1, keepdims=True) / _DEPTH
    plane = np.round(np.column_stack([normal / _STEP, along])).astype(np.int64)
    _, own, count = np.unique(plane, axis=0, return_inverse=True, return_counts=True)
    return count[own.reshape(-1)] >= _FLAT


def _mirrored(scene: RayScene, mirrors: _Pixels) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where rays of mirrors end: the places, the triangles, how wide the pixels are there, and what they show."""
    far = np.linalg.norm(mirrors.toward, axis=1, keepdims=True)
    direction = mirrors.toward / far
    direction -= 2 * (direction * mirrors.normal).sum(axis=1, keepdims=True) * mirrors.normal
    distance, triangle = scene.intersect(mirrors.position + scene.epsilon * mirrors.normal, direction)
    met = np.flatnonzero(triangle >= 0)
    place = mirrors.position[met] + distance[met, None] * direction[met]
    return place, triangle[met], mirrors.footprint[met] * (1 + distance[met] / far[met, 0]), mirrors.shown[met]


def _at_most(mesh: Mesh, place: np.ndarray, triangle: np.ndarray, width: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(T,) the brightest of what is shown of each triangle, by rays (N,) that end there or beside; inf of none."""
    most = np.full(len(mesh.triangles), -np.inf)
    np.maximum.at(most, triangle, shown)
    facing, centers = facings(mesh.area_normals), mesh.corners.mean(axis=1)
    for way in np.unique(facing[triangle]):
        rows, own = np.flatnonzero(facing[triangle] == way), np.flatnonzero(facing == way)
        near = cKDTree(centers[own]).query_ball_point(place[rows], 2 * width[rows], workers=-1)
        count = np.array([len(each) for each in near])
        np.maximum.at(most, own[np.concatenate(near).astype(np.int64)], np.repeat(shown[rows], count))
    return np.where(np.isfinite(most), most, np.inf)
