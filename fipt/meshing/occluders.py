"""Pixels that show something dark before the surface, which a mesh lacks.

A scan has no rod and no leaf that is thinner than its voxels. Where a view shows one, its pixels are taken for the wall
behind it, and what one view shows otherwise than others looks like metal. Where most views agree on how bright a piece
of surface is, and one is far darker, that view shows something else. What is far brighter may be a highlight.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import label, maximum_filter

from fipt.groups import grouped_median
from fipt.meshing.footprints import seen_surface
from fipt.meshing.radiance_edges import Radiance
from fipt.render.scene import RayScene
from fipt.robust import NORMAL
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.scene.voxels import FACINGS, facings, voxel_keys

_VIEWS = 3
"""That must see a cell: of two nobody knows which is wrong."""
_DARKER = 6.0
"""Standard deviations by which a view is darker than the median of a cell: with 3 or 4 more of what is left out is
creases and textures, of which each view sees other pixels."""
_CELL = 2.0
"""Side of a cell in pixels of the median distance: several pixels, and less than a thing's shadow."""
_LARGER = 8
"""Side of larger cells, in cells, in which the noise of a surface is measured as well: half a metre of a room."""
_CELLS = 1 << 18
"""Cells along the box; more than any room has."""
_STEP = 8.0
"""Pixels' widths by which surface beside a pixel is farther, so that this one is at the rim of a thing that the mesh
has: other views see the wall beside it in the same cell."""
_LEAST = 12
"""Connected pixels that are left out; fewer are one or two cells that are dark by chance."""
_NOISE = 0.01
"""Least relative deviation of views: images have as much."""
_MOST = 0.1
"""Share of the pixels of a view that are compared, above which it is wrong as a whole: things that a mesh lacks fill
less than a hundredth."""
_PASSES = 3
"""Times that the brightness of a view as a whole is taken off."""
_DARKEST = 1e-6
"""Least radiance that has a logarithm, of the median of what is seen."""


@dataclass(frozen=True)
class _ViewCells:
    """Cell of each pixel (P,) int32, -1: none; keys of cells (C,), mean and deviation of their logarithmic radiance."""

    cell: np.ndarray
    key: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray


def occluded(mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance) -> tuple[list[np.ndarray], list[str]]:
    """Find pixels that show something darker than the surface there; Mitsuba's variant must be set.

    Parameters
    ----------
    mesh
        Of a scan, or of photographs.
    cameras, radiance
        The training views, and what they show; pixels without weight are not compared.

    Returns
    -------
    masks
        (H, W) bool of each camera.
    odd
        Names of views that are darker in so many places that nothing is left out of them: misplaced, or of another day.
    """
    footprint = seen_surface(mesh, cameras).footprint
    masks, odd = [np.zeros((camera.height, camera.width), bool) for camera in cameras], []
    if len(footprint) == 0:
        return masks, odd
    scene, side = RayScene(mesh), _CELL * float(np.median(footprint))
    views = [_seen(scene, camera, radiance, side) for camera in cameras]
    for mask, camera, view, (compared, dark) in zip(masks, cameras, views, _darker(views), strict=True):
        found = np.append(dark, False)[view.cell]
        if found.sum() > _MOST * np.append(compared, False)[view.cell].sum():
            odd.append(camera.name)
            continue
        connected = label(found.reshape(mask.shape), np.ones((3, 3)))[0]
        mask |= found.reshape(mask.shape) & (np.bincount(connected.ravel())[connected] >= _LEAST)
    return masks, odd


def _seen(scene: RayScene, camera: Camera, radiance: Radiance, side: float) -> _ViewCells:
    """What a view says of cells that its pixel centres show; their ``side`` is in metres."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns, rows).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center, directions)
    color, valid = radiance(camera.name)
    depth = np.where(triangle >= 0, distance, np.inf).reshape(rows.shape)
    rim = maximum_filter(depth, 3, mode="nearest") > depth + _STEP * depth / max(camera.fx, camera.fy)
    usable = np.flatnonzero((triangle >= 0) & (valid > 0).ravel() & ~rim.ravel())
    place = camera.center + distance[usable, None] * directions[usable]
    keys = voxel_keys(place, np.zeros(3), side * _CELLS, _CELLS) * FACINGS + facings(scene.normals[triangle[usable]])
    key, own = np.unique(keys, return_inverse=True)
    own = own.reshape(-1)
    level = color.reshape(-1, 3)[usable].mean(axis=1, dtype=np.float64)
    level = np.log(np.maximum(level, _DARKEST * max(float(np.median(level)) if len(level) else 1.0, _DARKEST)))
    count = np.bincount(own, minlength=len(key))
    mean = np.bincount(own, level, len(key)) / np.maximum(count, 1)
    square = np.bincount(own, (level - mean[own]) ** 2, len(key)) / np.maximum(count, 1)
    cell = np.full(len(directions), -1, np.int32)
    cell[usable] = own
    return _ViewCells(cell, key, mean, np.sqrt(square))


def _around(key: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(C,) median of the ``noise`` (C,) of all cells that lie in one larger cell with each.

    In a mirror most cells are noisy, and those that are not by chance have the noise of the others. ``key`` (C,) is
    that of `_ViewCells`.
    """
    cell, facing = np.divmod(key, FACINGS)
    places = [cell // _CELLS**axis % _CELLS // _LARGER for axis in range(3)]
    large = ((places[2] * _CELLS + places[1]) * _CELLS + places[0]) * FACINGS + facing
    names, own = np.unique(large, return_inverse=True)
    return grouped_median(noise, own.reshape(-1), len(names))[own.reshape(-1)]


def _darker(views: Sequence[_ViewCells]) -> list[tuple[np.ndarray, np.ndarray]]:
    """(C,) bool of each view twice: its cells that views enough see, and those that are far darker than most say."""
    key, own = np.unique(np.concatenate([view.key for view in views]), return_inverse=True)
    own, count = own.reshape(-1), len(key)
    mean, within = (np.concatenate([getattr(view, name) for view in views]) for name in ("mean", "deviation"))
    several = np.bincount(own, minlength=count)[own] >= _VIEWS
    bounds = np.cumsum([0, *(len(view.key) for view in views)])
    cells = [slice(*ends) for ends in pairwise(bounds)]
    dark = np.zeros(len(own), bool)
    if several.any():
        off = grouped_median(mean, own, count)[own] - mean
        for _ in range(_PASSES):  # exposures are not known yet
            level = np.array([np.median(off[at][several[at]]) if several[at].any() else 0.0 for at in cells])
            mean = mean + np.repeat(level, np.diff(bounds))
            off = grouped_median(mean, own, count)[own] - mean
        room = max(NORMAL * float(np.median(np.abs(off[several]))), _NOISE)
        noise = np.maximum(NORMAL * grouped_median(np.abs(off), own, count), grouped_median(within, own, count))
        noise = np.maximum(noise, room)
        several_see = np.bincount(own, minlength=count) >= _VIEWS
        noise[several_see] = np.maximum(noise[several_see], _around(key[several_see], noise[several_see]))
        dark = several & (off > _DARKER * noise[own])
    return [(several[at], dark[at]) for at in cells]
