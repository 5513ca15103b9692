"""What mirrors show is not unseen: how bright surface is at most that views see by way of a mirror."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from scipy.ndimage import binary_erosion, binary_fill_holes, maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from fipt.model.parts import MaterialModel, seen_materials
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE, scattered
from fipt.scene.voxels import facings

_SMOOTH = 0.2
"""Roughness up to which metal is a mirror: fits give 0.14 to sharp ones. Spread over its lobe, a decimetre at 3 m, a
lamp of a room is still much brighter than surface."""
_MOST = 1 << 21
"""Pixels that the model is asked about, of the views that show most of mirrors: seconds."""
_FIRST = 1 << 18
"""Pixels of all views that tell which views these are."""
_BORDER = 2
"""Pixels along the border of a mirror that are not used: they may hold some of a lamp beside it."""
_DARK = 0.05
"""Base colour below which a mirror shows too little."""
_CHUNK = 1 << 14
"""Rays at a time: many small triangles may lie around each."""


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

    A mirror is smooth metal, so flat that what it shows is off by less than a pixel. The two pixels along its border do
    not count. It shows a triangle if one of its rays ends there, or within two widths of its pixel from the triangle's
    centre, on surface that faces the same way. Clipped and masked pixels, and whatever else it encloses and the model
    takes for no mirror, may show a lamp: they bound nothing, nor does what is shown beside them.

    Parameters
    ----------
    model
        The materials of the round before.

    Returns
    -------
    (T,) float64, the mean of the channels; inf where no mirror shows a triangle.
    """
    found = [_mirrors(data, shard, index, model) for shard, index in _views_with_mirrors(shards, model)]
    if sum(len(each.shown) for each in found) == 0:  # Dr.Jit traces no empty bundle
        return np.full(len(mesh.triangles), np.inf)
    mirrors = _Pixels(*(np.concatenate(column) for column in zip(*(astuple(each) for each in found), strict=True)))
    return _at_most(mesh, *_mirrored(RayScene(mesh), mirrors))


def _views_with_mirrors(shards: Sequence[ObservedShard], model: MaterialModel) -> list[tuple[ObservedShard, int]]:
    """Shards and numbers of the views that show most of the mirrors, `_MOST` pixels in all."""
    views = [(shard, index) for shard in shards for index in range(len(shard.samples.views))]
    size = np.array([int(np.prod(shard.samples.shapes[index])) for shard, index in views])
    step = max(-(-int(size.sum()) // _FIRST), 1)
    share = np.zeros(len(views))
    for view, (shard, index) in enumerate(views):
        rows, _ = _alone(shard, index)
        share[view] = _smooth(shard, rows[scattered(0, len(rows), step)], model)[0].sum()
    order = np.argsort(-share, kind="stable")
    return [views[view] for view in order[(share[order] > 0) & (np.cumsum(size[order]) <= max(_MOST, size.max()))]]


def _alone(shard: ObservedShard, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Samples that fill their pixel in a view, and the pixels (of the view)."""
    own, pixel = shard.samples.of_view(index), shard.samples.pixel_of_sample(index)
    fills = np.asarray(shard.samples.weight[own]) >= ALONE
    return np.flatnonzero(fills) + own.start, pixel[fills]


def _smooth(shard: ObservedShard, rows: np.ndarray, model: MaterialModel) -> tuple[np.ndarray, np.ndarray]:
    """(N,) bool: which samples ``rows`` (N,) are of smooth metal, and (N, 3) their base colour."""
    names = ("position", "normal", "footprint", "triangle")
    brdf = seen_materials(model, *(np.asarray(getattr(shard.samples, name)[rows]) for name in names))
    base = np.asarray(brdf.base_color, np.float64)
    return (brdf.metallic > 0.5) & (brdf.roughness <= _SMOOTH) & (base.min(axis=1) > _DARK), base


def _mirrors(data: Dataset, shard: ObservedShard, index: int, model: MaterialModel) -> _Pixels:
    """Pixels of mirrors in a view; those that tell nothing show inf."""
    samples, first = shard.samples, shard.samples.pixels(index).start
    rows, pixel = _alone(shard, index)
    smooth, base = _smooth(shard, rows, model)
    use = smooth & (shard.weight[first + pixel] > 0) & ~shard.clipped[first + pixel]
    region, normal = np.zeros(samples.shapes[index], bool), np.zeros((*samples.shapes[index], 3), np.float32)
    region.flat[pixel] = smooth
    normal.reshape(-1, 3)[pixel] = samples.normal[rows]
    window = np.ones((2 * _BORDER + 1, 2 * _BORDER + 1), bool)
    inner = binary_erosion(binary_fill_holes(region), window).ravel()[pixel]
    bent = maximum_filter(normal, footprint=window[..., None]) - minimum_filter(normal, footprint=window[..., None])
    bent = np.linalg.norm(bent, axis=2).ravel()[pixel]
    position, footprint = np.asarray(samples.position[rows]), np.asarray(samples.footprint[rows])
    toward = position - data.camera(samples.views[index]).center.astype(np.float32)
    flat = 2 * bent <= footprint / np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
    shown = np.where(use, (shard.radiance[first + pixel] / np.maximum(base, _DARK)).mean(axis=1), np.inf)
    kept = np.flatnonzero(inner & (flat | ~use))
    return _Pixels(
        toward[kept],
        position[kept],
        normal.reshape(-1, 3)[pixel[kept]],
        footprint[kept],
        shown[kept],
    )


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
    """(T,) the brightest that is shown of each triangle by rays (N,) that end there or beside; inf where none does."""
    most = np.full(len(mesh.triangles), -np.inf)
    np.maximum.at(most, triangle, shown)
    facing, centers = facings(mesh.area_normals), mesh.corners.mean(axis=1)
    for way in np.unique(facing[triangle]):
        rows, own = np.flatnonzero(facing[triangle] == way), np.flatnonzero(facing == way)
        tree = cKDTree(centers[own])
        for chunk in np.array_split(rows, -(-len(rows) // _CHUNK)):
            near = tree.query_ball_point(place[chunk], 2 * width[chunk], workers=-1)
            count = np.array([len(each) for each in near])
            np.maximum.at(most, own[np.concatenate(near).astype(np.int64)], np.repeat(shown[chunk], count))
    return np.where(np.isfinite(most), most, np.inf)
