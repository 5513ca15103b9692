"""Radiance cache: the light that leaves the surface, averaged over all views (surface light field).

A record belongs to a voxel and to the axis that the surface faces there, so that the two sides of a shelf, or a pane
and the sill below it, do not lend each other their light.
"""

import numpy as np
from scipy.spatial import cKDTree

from fipt.io.hits import Hits, scene_box
from fipt.io.meshes import Mesh, connected_parts
from fipt.settings import Cache as CacheSettings

_INTERIOR = 0.95
"""Pixels of which one piece covers at least this share tell a voxel's radiance; others mix surfaces."""
_FACINGS = 6
_DIRECTIONS = np.repeat(np.eye(3, dtype=np.float32), 2, axis=0) * np.tile([[-1.0], [1.0]], (3, 1)).astype(np.float32)
"""Unit vector of each facing."""
_MIXED = 1e-3
"""Weight of those others: they count only where nothing better is known."""


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
    corners = mesh.corners
    inside = (corners.max(axis=1) > low).all(axis=1) & (corners.min(axis=1) < high).all(axis=1)
    areas = np.where(inside, mesh.areas, 0.0)
    # a huge triangle may reach far out of the box: cap its points and keep those inside
    counts = np.where(inside, 1 + np.minimum(areas / spacing**2, 4e6), 0).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    u = np.random.default_rng(seed).random((len(owner), 2), dtype=np.float32)
    root = np.sqrt(u[:, :1])
    a, b, c = corners[owner, 0], corners[owner, 1], corners[owner, 2]
    points = a * (1 - root) + b * (root * (1 - u[:, 1:])) + c * (root * u[:, 1:])
    keep = ((points > low) & (points < high)).all(axis=1)
    return points[keep].astype(np.float32), owner[keep]


def voxel_keys(points: np.ndarray, center: np.ndarray, side: float, resolution: int) -> np.ndarray:
    """(N,) int64 linear voxel index of (N, 3) points, x fastest; points outside go to the nearest voxel."""
    cell = np.floor((points - (center - side / 2)) * (resolution / side)).astype(np.int64)
    x, y, z = np.clip(cell, 0, resolution - 1).T
    return x + resolution * (y + resolution * z)


def facings(normals: np.ndarray) -> np.ndarray:
    """(N,) uint8 of (N, 3) normals: twice the axis nearest to them, plus one where they point along it."""
    axis = np.abs(normals).argmax(axis=1)
    return (2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)).astype(np.uint8)


def build(
    mesh: Mesh,
    shards: list[Hits],
    images: list[np.ndarray],
    weights: list[np.ndarray],
    settings: CacheSettings,
    clipped: list[np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Average the radiance of all pixels in voxels over the surface.

    Parameters
    ----------
    images, weights
        Per shard: (P, 3) float32 radiance and (P,) weight of its pixels.
    clipped
        Per shard: (P,) bool, pixels whose radiance is only a lower bound; None: there are none.

    Returns
    -------
    dict
        ``center`` (3,) float64 and ``side`` of the box (metres), ``resolution``; K records sorted by ``key`` (K,) int64
        of their voxel, then ``facing`` (K,) uint8; ``point`` (K, 3) float32 a point of that surface in the voxel,
        ``radiance`` (K, 3) float32, ``count`` (K,) float32 pixels that it fills (0: its radiance is mixed or not
        known), ``source`` (K,) int32 the record that stands for it where no view sees it: the nearest seen one, of
        the same connected part if it can be.
    """
    center, side = scene_box(shards)
    n = settings.resolution
    points, triangles, normals, radiance, weight, bound = [], [], [], [], [], []
    clipped = clipped or [np.zeros(len(valid), bool) for valid in weights]
    for hits, image, valid, above in zip(shards, images, weights, clipped, strict=True):
        pixel = np.repeat(np.arange(len(hits.offsets) - 1), np.diff(hits.offsets))
        points.append(np.asarray(hits.position))
        triangles.append(np.asarray(hits.triangle))
        normals.append(np.asarray(hits.normal))
        radiance.append(image[pixel])
        bound.append(above[pixel])
        weight.append(valid[pixel] * np.where(np.asarray(hits.weight) >= _INTERIOR, 1.0, _MIXED))
    surface, owner = surface_points(mesh, side / n / 3, center - side / 2, center + side / 2, seed=0)
    winding = mesh.normals[owner]
    place = np.concatenate([*points, surface, surface])  # surfaces have two sides
    owner = np.concatenate([*triangles, owner, owner])
    facing = facings(np.concatenate([*normals, winding, -winding]))
    record, first, index = np.unique(
        voxel_keys(place, center, side, n) * _FACINGS + facing, return_index=True, return_inverse=True
    )
    index = index.reshape(-1)[: len(place) - 2 * len(surface)]
    weights = np.concatenate(weight)
    values = _raised(index, np.concatenate(radiance), weights, np.concatenate(bound), len(record))
    mean, _ = _means(index, values, weights, len(record))
    count = np.bincount(index, weights * (weights > _MIXED), len(record))
    seen = np.zeros(len(record), bool)
    seen[index[weights > 0]] = True
    return {
        "center": center,
        "side": np.float64(side),
        "resolution": np.int64(n),
        "key": record // _FACINGS,
        "facing": facing[first],
        "point": place[first],
        "radiance": mean.astype(np.float32),
        "count": count.astype(np.float32),
        "source": _nearest_seen(place[first], facing[first], connected_parts(mesh)[owner[first]], seen, 8 * side / n),
    }


def _raised(index: np.ndarray, values: np.ndarray, weight: np.ndarray, bound: np.ndarray, size: int) -> np.ndarray:
    """(N, 3) values in which lower bounds do not darken their record.

    A bound below what others measure there says nothing new and counts as they do; a surface of which there are
    only bounds is at least as bright as the highest of them.
    """
    if not bound.any():
        return values
    mean, measured = _means(index, values, weight * ~bound, size)
    highest = np.zeros((size, 3))
    usable = bound & (weight > _MIXED)
    np.maximum.at(highest, index[usable], values[usable])
    least = np.where(measured[:, None] > 0, mean, highest)
    return np.where(bound[:, None], np.maximum(values, least[index]), values)


def _means(index: np.ndarray, values: np.ndarray, weight: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    count = np.bincount(index, weight, size)
    total = np.stack([np.bincount(index, weight * values[:, c], size) for c in range(3)], axis=1)
    return total / np.maximum(count, 1e-12)[:, None], count


def _nearest_seen(
    points: np.ndarray, facing: np.ndarray, part: np.ndarray, seen: np.ndarray, turn: float
) -> np.ndarray:
    """(K,) int32 index of the nearest seen point, of the same connected part where that has one; itself where seen.

    A surface that faces another way counts as ``turn`` metres further away.
    """
    source = np.arange(len(points), dtype=np.int32)
    if seen.all() or not seen.any():
        return source
    extent = float(np.ptp(points, axis=0).max()) + 1.0
    points = np.concatenate([points, turn * _DIRECTIONS[facing]], axis=1)
    # the part as one more coordinate, so far apart that another part is nearest only where its own is unseen
    place = np.concatenate([points, part[:, None] * (4.0 * extent)], axis=1)
    _, same = cKDTree(place[seen]).query(place[~seen], workers=-1)
    _, any_part = cKDTree(points[seen]).query(points[~seen], workers=-1)
    chosen = np.flatnonzero(seen)
    own = part[chosen[same]] == part[~seen]
    source[~seen] = np.where(own, chosen[same], chosen[any_part])
    return source
