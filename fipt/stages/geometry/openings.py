"""Openings: surface that pictures put where they see far outside, told by what stands still as the camera moves.

Depth ends at the bars of a window, and panes close it. Seen from two places, a surface shows the same radiance in the
same place; what lies far outside shows it in the same direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fipt.conventions import LUMINANCE
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView, pixels_of

_BRIGHT = 4.0
"""Luminance, in medians of all views, of what may be outside: a day is brighter than a room. Saves time, too."""
_COLUMNS = 160
"""Pixels of a view along its longer side that are asked, about."""
_SHIFT, _PARALLAX = np.radians(2.5), np.radians(5.0)
"""How far beside its direction a pixel is compared for chance, and how far apart two cameras must see its place: what
lies there moves past the shifted directions."""
_NEAR = 1.5
"""Metres around a pixel's place within which another view's must be: what shines elsewhere in the room is no match."""
_ALIKE = 0.03
"""Difference of log luminance up to which two pixels match, as `superpixels` has it."""
_PATCH = 0.2
"""Metres: side of the blocks of surface in which matches are counted."""
_DEVIATIONS, _OFTENER, _LEAST = 5.0, 2.0, 20
"""Matches in a block must be beyond chance by so many deviations, so many times as frequent, of so many tries at least.
No block of surface was in the room that this was found on."""
_GAP = 3.5
"""Blocks between which an opening goes on: bars and pillars are narrower."""
_BLOCKS = 3
"""Blocks of the smallest opening: fewer have no plane."""
_THICK = 0.1
"""Metres from its plane within which surface closes an opening: depth there is that of bars."""
_DARKEST = 0.1
"""Share of matched pixels that are darker than what opens. Bars are, and stay."""
_LAYERS = 4
"""Surfaces behind each other that a ray may meet on its way out."""


@dataclass(frozen=True)
class _SeenView:
    """What a view shows: log luminance (H, W), place (H, W, 3), triangle (H, W), and whether it is bright (H, W)."""

    camera: Camera
    rays: np.ndarray
    light: np.ndarray
    place: np.ndarray
    triangle: np.ndarray
    bright: np.ndarray


@dataclass(frozen=True)
class _Samples:
    """Bright pixels: place (N, 3), log luminance (N,), and matches and tries (N, 2) along and beside its direction."""

    place: np.ndarray
    light: np.ndarray
    matches: np.ndarray
    tries: np.ndarray


def find_openings(mesh: Mesh, views: Sequence[DepthView]) -> np.ndarray:
    """Tell which triangles close an opening to what lies far outside.

    In blocks of bright surface, pixels are compared with those of other views that look in the same direction, and in
    directions a little beside it. Where the same direction matches far more often than chance, the outside is seen.
    Such blocks lie on planes; what is as bright there is open, and bars stay. An outside without any
    contrast is not told from a pane that shines: it stays one.

    Parameters
    ----------
    mesh
        Closed around the cameras.
    views
        With their pictures; depth is not used.

    Returns
    -------
    open
        (T,) bool, with what lies behind openings.
    """
    scene, count = RayScene(mesh), len(mesh.triangles)
    seen = _seen(scene, views)
    planes = _planes(_samples(seen))
    middle = _middle_light(seen, count)
    open_ = np.zeros(count, bool)
    for center, normal, least in planes:
        near = np.zeros(count, bool)
        for view in seen:
            on = (view.triangle >= 0) & (np.abs((view.place - center) @ normal) < _THICK)
            near[view.triangle[on]] = True
        open_ |= near & (middle >= least)
    return open_ | _behind(mesh, seen, open_)


def _seen(scene: RayScene, views: Sequence[DepthView]) -> list[_SeenView]:
    lights = [np.log(np.maximum(view.radiance @ LUMINANCE, 1e-6)).astype(np.float32) for view in views]
    least = float(np.median(np.concatenate([light[::4, ::4].ravel() for light in lights]))) + np.log(_BRIGHT)
    result = []
    for view, light in zip(views, lights, strict=True):
        rays = view.rays / np.linalg.norm(view.rays, axis=-1, keepdims=True)
        distance, triangle = scene.intersect(view.camera.center, rays.reshape(-1, 3).astype(np.float32))
        met = triangle >= 0
        place = view.camera.center + np.where(met, distance, 0)[:, None] * rays.reshape(-1, 3)
        shape = light.shape
        bright = (light > least) & met.reshape(shape)
        result.append(_SeenView(view.camera, rays, light, place.reshape(*shape, 3), triangle.reshape(shape), bright))
    return result


def _samples(seen: Sequence[_SeenView]) -> _Samples:
    """Compare bright pixels of each view with all other views."""
    places, lights = [np.zeros((0, 3))], [np.zeros(0)]
    matches, tries = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2), np.int64)]
    for view in seen:
        step = max(1, round(max(view.light.shape) / _COLUMNS))
        some = np.zeros(view.light.shape, bool)
        some[::step, ::step] = view.bright[::step, ::step]
        found = np.zeros((2, int(some.sum()), 2), np.int64)
        for other in seen:
            if other is not view:
                found += _compared(view.rays[some], view.place[some], view.light[some], other)
        places.append(view.place[some])
        lights.append(view.light[some])
        matches.append(found[0])
        tries.append(found[1])
    return _Samples(*map(np.concatenate, (places, lights, matches, tries)))


def _compared(rays: np.ndarray, place: np.ndarray, light: np.ndarray, other: _SeenView) -> np.ndarray:
    """(2, N, 2) int64 matches and tries in another view, along unit rays (N, 3) and beside them."""
    towards = place - other.camera.center
    parallax = (towards * rays).sum(axis=1) < np.cos(_PARALLAX) * np.linalg.norm(towards, axis=1)
    u = np.cross(rays, np.eye(3)[np.abs(rays).argmin(axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(rays, u)
    found = np.zeros((2, len(rays), 2), np.int64)
    for number, beside in enumerate((0 * u, u, -u, v, -v)):
        row, column, _, inside = pixels_of(other.camera, other.camera.center + rays + np.tan(_SHIFT) * beside)
        tried = parallax & inside & other.bright[row, column]
        tried &= ((other.place[row, column] - place) ** 2).sum(axis=1) < _NEAR**2
        matched = tried & (np.abs(other.light[row, column] - light) < _ALIKE)
        found[:, :, min(number, 1)] += matched, tried
    return found


def _planes(samples: _Samples) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Centre (3,), normal (3,) and least log luminance of each opening."""
    if len(samples.place) == 0:
        return []
    cells, block = np.unique(np.floor(samples.place / _PATCH).astype(np.int64), axis=0, return_inverse=True)
    block = block.reshape(-1)
    (along, beside), (tried, chances) = (
        [np.bincount(block, column, len(cells)) for column in counts.T] for counts in (samples.matches, samples.tries)
    )
    rate, chance = along / np.maximum(tried, 1), beside / np.maximum(chances, 1)
    both = (along + beside) / np.maximum(tried + chances, 1)
    deviation = np.sqrt(both * (1 - both) * (1 / np.maximum(tried, 1) + 1 / np.maximum(chances, 1)))
    beyond = (tried >= _LEAST) & (rate > _OFTENER * chance) & (rate - chance > _DEVIATIONS * deviation)
    outside = np.flatnonzero(beyond)
    pairs = cKDTree(cells[outside]).query_pairs(_GAP, output_type="ndarray") if len(outside) else np.zeros((0, 2), int)
    links = coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(outside),) * 2)
    number, opening = connected_components(links, directed=False)
    found = []
    for k in range(number):
        if (opening == k).sum() < _BLOCKS:
            continue
        on = np.isin(block, outside[opening == k])
        center = np.median(samples.place[on], axis=0)
        normal = np.linalg.svd(samples.place[on] - center, full_matrices=False)[2][2]
        matched = on & (samples.matches[:, 0] > 0)
        found.append((center, normal, float(np.quantile(samples.light[matched], _DARKEST))))
    return found


def _middle_light(seen: Sequence[_SeenView], count: int) -> np.ndarray:
    """(T,) median log luminance of the pixels that show each triangle; minus infinity where none does."""
    triangle, light = (np.concatenate([getattr(view, name).ravel() for view in seen]) for name in ("triangle", "light"))
    order = np.lexsort((light, triangle))
    start, end = (np.searchsorted(triangle[order], np.arange(count), side=side) for side in ("left", "right"))
    middle = light[order][np.minimum((start + end) // 2, len(order) - 1)]
    return np.where(end > start, middle, -np.inf)


def _behind(mesh: Mesh, seen: Sequence[_SeenView], open_: np.ndarray) -> np.ndarray:
    """(T,) bool: what rays through openings meet behind them, and no other pixel shows."""
    behind, shown = np.zeros(len(open_), bool), np.zeros(len(open_), bool)
    origins, ways = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for view in seen:
        through = (view.triangle >= 0) & open_[view.triangle]
        shown[view.triangle[(view.triangle >= 0) & ~through]] = True
        origins.append(np.broadcast_to(view.camera.center, (int(through.sum()), 3)))
        ways.append(view.rays[through])
    origin, way = np.concatenate(origins), np.concatenate(ways).astype(np.float32)
    for _ in range(_LAYERS):
        left = np.flatnonzero(~(open_ | behind))
        if len(origin) == 0 or len(left) == 0:
            break
        _, triangle = RayScene(Mesh(mesh.vertices, mesh.triangles[left])).intersect(origin.astype(np.float32), way)
        met = triangle >= 0
        new = left[triangle[met]]
        new = new[~shown[new]]
        if len(new) == 0:
            break
        behind[new] = True
        origin, way = origin[met], way[met]
    return behind
