"""Sharp edges of radiance on the surface: found in each view, kept where the other views agree.

An emitter of a scan is part of one connected surface; what bounds it is the edge of its light. An edge that moves with
the viewer (a mirror's image, the outline of something before the surface) belongs to no place on it and is dropped.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from fipt.conventions import LUMINANCE
from fipt.render.scene import RayScene
from fipt.scene.blocks import block_mean, blocks
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

JUMP = 2.0
"""Ratio of luminance across an edge: more than shading and most paint make, less than a dim emitter against a wall."""
_DARKEST = 0.01
"""Luminance that is added before a ratio is taken, in medians of the view: noise of dark pixels is no edge."""
_POINTS = 400_000
"""Edge points kept of all views at most."""
_PIXELS = 400_000
"""Pixels of a view that are looked at most; those of larger images are averaged in blocks."""
_BORDER = 2
"""Pixels along the sides of a view where no edge is found: its neighbours are not known."""
_FLAT = 1.0
"""Distance in footprints of the neighbours' surface from the plane at an edge above which the edge is an outline."""
_SAME_DEPTH = 3.0
"""Distance in footprints within which a view sees a point rather than something before it."""
_AGREE = 0.5
"""Share of the other views that see the place and must see the edge."""

Radiance = Callable[[str], tuple[np.ndarray, np.ndarray]]
"""View -> (H, W, 3) radiance and (H, W) weights."""


@dataclass(frozen=True)
class RadianceEdges:
    """Points of edges on the surface.

    Attributes
    ----------
    position
        (N, 3) float64, metres.
    footprint
        (N,) float64 side of the pixel that saw it, metres.
    """

    position: np.ndarray
    footprint: np.ndarray

    def __len__(self) -> int:
        """How many points."""
        return len(self.position)


@dataclass(frozen=True)
class _View:
    """One view's depth (H, W), where it has an edge (H, W) and could have one (H, W), and its edge points (N, 3) with
    footprints (N,).
    """

    camera: Camera
    depth: np.ndarray
    edge: np.ndarray
    searched: np.ndarray
    position: np.ndarray
    footprint: np.ndarray


def find_edges(mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance) -> RadianceEdges:
    """Find the radiance edges of a mesh; Mitsuba's variant must be set."""
    scene = RayScene(mesh)
    most = _POINTS // max(len(cameras), 1)
    views = [_seen(scene, *reduced_view(camera, radiance), most) for camera in cameras]
    position = np.concatenate([view.position for view in views])
    footprint = np.concatenate([view.footprint for view in views])
    own = np.repeat(np.arange(len(views)), [len(view.position) for view in views])
    seen, agreed = np.zeros(len(position)), np.zeros(len(position))
    for number, view in enumerate(views):
        visible, edge = _votes(view, position)
        other = own != number
        seen += visible & other
        agreed += visible & edge & other
    keep = agreed >= _AGREE * seen
    return RadianceEdges(position[keep], footprint[keep])


def reduced_view(camera: Camera, radiance: Radiance) -> tuple[Camera, np.ndarray, np.ndarray]:
    """View in which edges are looked for, radiance (H, W, 3) and weights (H, W): of `_PIXELS` pixels at most."""
    return reduced(camera, *radiance(camera.name), _PIXELS)


def reduced(
    camera: Camera, radiance: np.ndarray, valid: np.ndarray, most: int
) -> tuple[Camera, np.ndarray, np.ndarray]:
    """View of at most about ``most`` pixels: means over square blocks; one has weight where all its pixels have."""
    step = int(np.ceil(np.sqrt(camera.width * camera.height / most)))
    if step <= 1:
        return camera, radiance, valid
    return camera.reduced(step), block_mean(radiance, step), blocks(valid, step).min(axis=(1, 3))


def _votes(view: _View, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) bool: whether the view sees each point and could tell an edge there; whether it has one within a pixel."""
    image, depth = view.camera.project(position)
    column, row = np.floor(image).astype(np.int64).T
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < view.camera.width) & (row < view.camera.height)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    near = np.abs(view.depth[row, column] - depth) < _SAME_DEPTH * depth / view.camera.fx
    return inside & near & view.searched[row, column], view.edge[row, column]


def _seen(scene: RayScene, camera: Camera, radiance: np.ndarray, valid: np.ndarray, most: int) -> _View:
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    depth = _surface(scene, camera, columns.ravel(), rows.ravel())[0].astype(np.float32)
    column, row = edge_points(radiance @ LUMINANCE, valid)
    edge = np.zeros(depth.size, bool).reshape(rows.shape)
    edge[row.astype(np.int64), column.astype(np.int64)] = True
    step = max(1, -(-len(column) // max(most, 1)))
    column, row = column[::step], row[::step]
    along, position, normal, met = _surface(scene, camera, column, row)
    footprint = along / camera.fx
    for right, down in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        _, place, _, other = _surface(scene, camera, column + right, row + down)
        met &= other & (np.abs(((place - position) * normal).sum(axis=1)) < _FLAT * footprint)
    edge, footprint = maximum_filter(edge, 3), footprint[met].astype(np.float64)
    return _View(camera, depth.reshape(rows.shape), edge, _searched(valid), position[met], footprint)


def _surface(
    scene: RayScene, camera: Camera, columns: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Depth along the view axis, place, normal, and whether there is a surface, at image points."""
    directions = camera.directions(columns, rows).reshape(-1, 3)
    distance, triangle = np.zeros(0, np.float32), np.zeros(0, np.int32)
    if len(directions):  # no rays are too few for Mitsuba
        distance, triangle = scene.intersect(camera.center, directions)
    met = triangle >= 0
    distance = np.where(met, distance, 0.0).astype(np.float64)
    depth = distance * -(directions.astype(np.float64) @ camera.world_from_camera[:3, 2])
    return np.where(met, depth, np.inf), camera.center + distance[:, None] * directions, scene.normals[triangle], met


def _searched(valid: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels of (H, W) weights at which edges are looked for: not beside those without, nor at a side."""
    searched = minimum_filter(valid > 0, 3)
    searched[:_BORDER], searched[-_BORDER:], searched[:, :_BORDER], searched[:, -_BORDER:] = False, False, False, False
    return searched


def edge_points(luminance: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows, (N,) float64 image coordinates, of sharp edges, to fractions of a pixel.

    Parameters
    ----------
    luminance
        (H, W). A pixel that an edge crosses shows a mixture linear in the area of either side, so the place is that of
        the steepest luminance, not of its logarithm.
    valid
        (H, W) weights; no edge is found beside pixels without any.
    """
    usable, searched = valid > 0, _searched(valid)
    if not searched.any():
        return np.zeros(0), np.zeros(0)
    floor = _DARKEST * max(float(np.median(luminance[usable])), 1e-12)
    bright = np.where(usable, luminance, 0.0) + floor
    ratio = maximum_filter(bright, 3) / minimum_filter(bright, 3)
    strong = (ratio > JUMP) & searched
    dy, dx = np.gradient(bright)
    steep = np.hypot(dx, dy)
    found = []
    for size, other, axis in ((np.abs(dx), np.abs(dy), 1), (np.abs(dy), np.abs(dx), 0)):
        before, after = np.roll(steep, 1, axis), np.roll(steep, -1, axis)
        here = strong & (size >= other) & (steep >= before) & (steep > after)
        row, column = np.nonzero(here)
        low, mid, high = before[here], steep[here], after[here]
        shift = np.clip(0.5 * (low - high) / np.minimum(low - 2 * mid + high, -1e-30), -0.5, 0.5)
        found.append((column + 0.5 + shift * (axis == 1), row + 0.5 + shift * (axis == 0)))
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])
