"""Surface that an edge of radiance encloses becomes a connected part of its own, as a modeller would have made it.

A pixel on the border then shows two pieces, not a mixture on one, and what is known of a part (such as that it glows
wherever it is seen) does not end at triangles that no pixel fills.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter, minimum_filter

from fipt.conventions import LUMINANCE
from fipt.groups import connected_groups
from fipt.meshing.radiance_edges import JUMP, Radiance, reduced_view
from fipt.meshing.topology import neighbours, pieces, side_list
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_WINDOW = 5
"""Side of the window in pixels whose darkest and brightest luminance are an edge's two sides: two pixels either way, of
which the first may be a mixture."""
_SAME_DEPTH = 3.0
"""Distance in footprints within which a view sees a point rather than something before it."""
_SMALLEST = 4.0
"""Area in footprints of the smallest region that is separated: it fills a pixel."""
_OVERLAP = 2e-5
"""Metres by which separated surfaces overlap, so that no ray passes between them: some roundings of coordinates."""
_UNSEEN = 2


def separated(mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance) -> tuple[Mesh, int]:
    """Part the mesh where radiance edges enclose a region; return it and how many regions there are."""
    side, footprint = sides(mesh, cameras, radiance)
    pairs = neighbours(mesh.triangles)
    one, other = side[pairs.T]
    joined = ((one == other) | (one == 0) | (other == 0)) & (one != _UNSEEN) & (other != _UNSEEN)
    region = _with_unseen(connected_groups(pairs[joined].T, len(side)), side == _UNSEEN, pairs)
    area = np.bincount(region, mesh.areas / footprint**2)
    own = area >= _SMALLEST
    own &= np.bincount(region, side != _UNSEEN, len(own)) > 0  # around what no view sees, none shows an edge
    # what surrounds everything is no enclosed region: the largest of each piece of the mesh
    own[_largest(pieces(mesh), region, area)] = False
    return _parted(mesh, np.where(own[region], np.cumsum(own)[region], 0)), int(own.sum())


def sides(mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance) -> tuple[np.ndarray, np.ndarray]:
    """On which side of an edge triangles lie, by the median of the views that see their middles.

    Returns
    -------
    side
        (T,) int8: 1 the bright side, -1 the dark one, 0 no edge near, 2 unseen.
    footprint
        (T,) float64 median of the pixels' sides, metres; that of all triangles where unseen.
    """
    scene, center = RayScene(mesh), mesh.corners.mean(axis=1).astype(np.float64)
    values = np.full((3, len(cameras), len(center)), np.nan, np.float32)
    for number, camera in enumerate(cameras):
        view, image, valid = reduced_view(camera, radiance)
        seen, at, far = _visible(scene, view, valid, center)
        if len(seen) == 0:
            continue
        shown = valid > 0  # what is masked may hold anything
        luminance = np.where(shown, image @ LUMINANCE, 0)
        luminance = luminance + 1e-3 * max(float(np.median(luminance[shown])), 1e-12)
        column, row = np.floor(at).astype(np.int64).T
        dark = minimum_filter(np.where(shown, luminance, np.inf), _WINDOW)[row, column]
        bright = maximum_filter(np.where(shown, luminance, 0), _WINDOW)[row, column]
        # between pixels, luminance is linear in the area of either side
        here = map_coordinates(luminance, at.T[::-1] - 0.5, order=1, mode="nearest")
        here = np.clip(here, dark, bright)  # beside what is masked
        values[0, number, seen] = (here - dark) / np.maximum(bright - dark, 1e-30)
        values[1, number, seen] = bright / dark
        values[2, number, seen] = far / view.fx
    known = np.isfinite(values[2]).any(axis=0)
    share, ratio, footprint = np.nanmedian(values[:, :, known], axis=1)
    side = np.full(len(center), _UNSEEN, np.int8)
    side[known] = np.where(ratio < JUMP, 0, np.where(share > 0.5, 1, -1))
    size = np.full(len(center), float(np.median(footprint)) if known.any() else 1.0)
    size[known] = footprint
    return side, size


def _visible(
    scene: RayScene, camera: Camera, valid: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points that a view sees: which (M,), image coordinates (M, 2) and distances (M,) in metres."""
    at, depth = camera.project(points)
    inside = (depth > 0) & (at >= 0).all(axis=1) & (at < [camera.width, camera.height]).all(axis=1)
    chosen = np.flatnonzero(inside)
    column, row = np.floor(at[chosen]).astype(np.int64).T
    chosen = chosen[valid[row, column] > 0]
    if len(chosen) == 0:
        return chosen, at[chosen], np.zeros(0)
    away = points[chosen] - camera.center
    far = np.linalg.norm(away, axis=1)
    met, _ = scene.intersect(camera.center, (away / far[:, None]).astype(np.float32))
    near = np.abs(met - far) < _SAME_DEPTH * far / camera.fx
    return chosen[near], at[chosen[near]], far[near]


def _with_unseen(region: np.ndarray, unseen: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Regions (T,) in which unseen triangles belong to those beside them, from the border of what is seen inwards."""
    region, open_ = region.copy(), unseen.copy()
    while True:
        took = open_.copy()
        for one, other in (pairs.T, pairs.T[::-1]):
            asks = open_[one] & ~open_[other]
            region[one[asks]] = region[other[asks]]
            took[one[asks]] = False
        if (took == open_).all():
            return region
        open_ = took


def _largest(piece: np.ndarray, region: np.ndarray, area: np.ndarray) -> np.ndarray:
    """The largest region of each piece of the mesh."""
    of = np.zeros(len(area), np.int64)
    of[region] = piece
    order = np.lexsort((area, of))
    return order[np.append(of[order][1:] != of[order][:-1], True)]


def _parted(mesh: Mesh, label: np.ndarray) -> Mesh:
    """Mesh whose triangles of different (T,) labels share no vertex; label 0 keeps the vertices as they are."""
    count = int(label.max(initial=0)) + 1
    keys, index = np.unique(mesh.triangles.astype(np.int64) * count + label[:, None], return_inverse=True)
    index = index.reshape(-1, 3)
    vertex, of = np.divmod(keys, count)
    place = mesh.vertices[vertex].astype(np.float64)
    # out of the region, across the sides that it shares with another: both surfaces then lie over the border
    ends, side = side_list(mesh.triangles)
    least, most = np.full(len(ends), count), np.full(len(ends), -1)
    np.minimum.at(least, side, label[:, None])
    np.maximum.at(most, side, label[:, None])
    triangle, slot = np.nonzero((least < most)[side] & (label > 0)[:, None])
    start, end = index[triangle, slot], index[triangle, (slot + 1) % 3]
    out = np.cross(place[end] - place[start], mesh.normals[triangle])
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)
    away = np.zeros_like(place)
    np.add.at(away, start, out)
    np.add.at(away, end, out)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-30)
    place += np.where(of > 0, _OVERLAP, 0.0)[:, None] * away
    return Mesh(place.astype(np.float32), index.astype(np.int32))
