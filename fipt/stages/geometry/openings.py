"""Openings: surface that pictures put where they see far outside, told by what stands still as the camera moves.

Depth ends at the bars of a window, and panes close it. Seen from two places, a surface shows the same radiance in the
same place; what lies far outside shows it in the same direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.conventions import LUMINANCE
from fipt.groups import connected_groups
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView, pixels_of

_BRIGHT = 4.0
"""Luminance, in medians of all views, of what may be outside: a day is brighter than a room. Saves time, too."""
_DARK = 1e-6
"""Luminance that counts as none."""
_COLUMNS = 160
"""Pixels of a view along its longer side that are asked, about."""
_SHIFT, _PARALLAX = np.radians(2.5), np.radians(5.0)
"""How far beside its direction a pixel is compared for chance, and how far apart two cameras must see its place: what
lies there moves past the shifted directions."""
_NEAR = 1.5
"""Metres around a pixel's place within which another view's must be: what shines elsewhere in the room is no match."""
_ALIKE = 0.03
"""Difference of log luminance up to which two pixels match, as `superpixels` has it."""
_BLOCK = 0.2
"""Metres: side of the blocks of surface in which matches are counted."""
_DEVIATIONS, _OFTENER, _LEAST = 5.0, 2.0, 20
"""Matches in a block must be beyond chance by so many deviations, so many times as frequent, of so many tries at least,
along the direction and beside it. No block of surface was in the room that this was found on."""
_GAP, _TOUCH = 3.5, 1.8
"""Blocks between which contrast goes on as one opening: bars and pillars are narrower. Other blocks must touch."""
_BLOCKS = 3
"""Blocks with contrast of the smallest opening: fewer have no plane."""
_AS_OFTEN = 0.5
"""Matches of a block without contrast, as a share of what blocks with contrast have in the middle."""
_SPREAD = float(np.log(2.0))
"""Range of log luminance of another window in the same plane, at least: a lamp shines alike all over."""
_THICK = 0.1
"""Metres from its plane within which surface closes an opening: depth there is that of bars."""
_FACING = 0.5
"""Cosine between the normals of its plane and of what closes an opening, at least: reveals stay."""
_DARKEST = 0.1
"""Share of a block's matched pixels that are darker than what opens. Bars are, and stay."""
_DARK_BLOCKS = 0.25
"""Share of the blocks in which that is darker than what opens: some show bars alone."""
_LAYERS = 4
"""Surfaces behind each other that a ray may meet on its way out."""
_PARTNERS = 40
"""Other views that a view is compared with, at most, evenly chosen."""


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


@dataclass(frozen=True)
class _Opening:
    """What closes openings of one plane.

    Attributes
    ----------
    cells
        (K, 3) int64 numbers of its blocks along the axes.
    least
        Log luminance of what is open.
    center, normal
        (3,) of the plane, metres.
    """

    cells: np.ndarray
    least: float
    center: np.ndarray
    normal: np.ndarray

    def shown_in(self, view: _SeenView, normals: np.ndarray) -> np.ndarray:
        """(H, W) bool: pixels of what closes them, of triangles with normals (T, 3)."""
        place, triangle = view.place.reshape(-1, 3), view.triangle.ravel()
        bright = (triangle >= 0) & (view.light.ravel() >= self.least)
        bright &= (np.abs(normals @ self.normal) > _FACING)[triangle]
        near = np.flatnonzero(bright & (np.abs((place - self.center) @ self.normal) < _THICK))
        away, _ = cKDTree(self.cells).query(np.floor(place[near] / _BLOCK), distance_upper_bound=0.5)
        shown = np.zeros(view.light.shape, bool)
        shown.ravel()[near[np.isfinite(away)]] = True
        return shown


def find_openings(mesh: Mesh, views: Sequence[DepthView]) -> np.ndarray:
    """Tell which triangles close an opening to what lies far outside.

    In blocks of bright surface, pixels are compared with those of other views that look in the same direction, and in
    directions a little beside it. Where the same direction matches far more often than chance, the outside is seen.
    Such blocks lie on a plane. What touches them there and is as bright as what matched is open, and so are other
    windows in that plane; bars are darker, and stay. Where nothing outside has any contrast, it is not told from a pane
    that shines: it stays one.

    Parameters
    ----------
    mesh
        Closed around the cameras.
    views
        With their pictures, at least one; depth is not used.

    Returns
    -------
    open
        (T,) bool, with what lies behind openings.
    """
    scene, count = RayScene(mesh), len(mesh.triangles)
    seen = _seen(scene, views)
    found = _openings(_samples(seen))
    pixels, shown = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for view in seen:
        met = view.triangle >= 0
        through = np.zeros_like(met)
        for opening in found:
            through |= opening.shown_in(view, mesh.normals)
        pixels += np.bincount(view.triangle[met], minlength=count)
        shown += np.bincount(view.triangle[met & through], minlength=count)
    open_ = 2 * shown > pixels
    return open_ | _behind(mesh, seen, open_)


def _seen(scene: RayScene, views: Sequence[DepthView]) -> list[_SeenView]:
    lights = [np.log(np.maximum(view.radiance @ LUMINANCE, _DARK)).astype(np.float32) for view in views]
    some = np.concatenate([light[::4, ::4].ravel() for light in lights])
    some = some[some > np.log(_DARK)]  # pixels that are not valid are black
    least = (float(np.median(some)) if len(some) else 0.0) + np.log(_BRIGHT)
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
        others = [other for other in seen if other is not view]
        for k in np.unique(np.linspace(0, len(others) - 1, min(len(others), _PARTNERS)).astype(np.int64)):
            found += _compared(view.rays[some], view.place[some], view.light[some], others[k])
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


def _openings(samples: _Samples) -> list[_Opening]:
    if len(samples.place) == 0:
        return []
    cells, block = np.unique(np.floor(samples.place / _BLOCK).astype(np.int64), axis=0, return_inverse=True)
    block = block.reshape(-1)
    (along, beside), (tried, chances) = (
        [np.bincount(block, column, len(cells)) for column in counts.T] for counts in (samples.matches, samples.tries)
    )
    rate, chance = along / np.maximum(tried, 1), beside / np.maximum(chances, 1)
    both = (along + beside) / np.maximum(tried + chances, 1)
    deviation = np.sqrt(both * (1 - both) * (1 / np.maximum(tried, 1) + 1 / np.maximum(chances, 1)))
    enough = np.minimum(tried, chances) >= _LEAST
    beyond = np.flatnonzero(enough & (rate > _OFTENER * chance) & (rate - chance > _DEVIATIONS * deviation))
    result = []
    for contrast in _connected(cells, beyond, _GAP):
        on = np.isin(block, contrast)
        center = np.median(samples.place[on], axis=0)
        _, extent, axes = np.linalg.svd(samples.place[on] - center, full_matrices=False)
        if len(contrast) < _BLOCKS or extent[1] < _BLOCK / 4 * np.sqrt(on.sum()):
            continue  # a row of blocks has no plane
        flat = np.abs((cells + 0.5) * _BLOCK @ axes[2] - center @ axes[2]) < _BLOCK
        often = np.flatnonzero(enough & flat & (rate >= _AS_OFTEN * np.median(rate[contrast])))
        darkest = [_quantile(samples, block == k, _DARKEST, matched=True) for k in np.union1d(often, contrast)]
        least = float(np.quantile(darkest, _DARK_BLOCKS)) - _ALIKE
        bright = np.flatnonzero(flat & (np.bincount(block, samples.light >= least, len(cells)) > 0))
        groups = [
            group
            for group in _connected(cells, np.union1d(contrast, bright), _TOUCH)
            if np.isin(group, contrast).any() or _range(samples, np.isin(block, group)) > _SPREAD
        ]
        result.append(_Opening(cells[np.concatenate(groups)], least, center, axes[2]))
    return result


def _connected(cells: np.ndarray, chosen: np.ndarray, reach: float) -> list[np.ndarray]:
    """Groups of chosen blocks that reach each other; numbers of their cells (K, 3)."""
    pairs = cKDTree(cells[chosen]).query_pairs(reach, output_type="ndarray") if len(chosen) else np.zeros((0, 2), int)
    group = connected_groups(pairs.T, len(chosen))
    return [chosen[group == k] for k in range(group.max(initial=-1) + 1)]


def _quantile(samples: _Samples, chosen: np.ndarray, share: float, matched: bool = False) -> float:
    """Log luminance that a share of chosen samples (N,) is below, or of those of them that matched."""
    use = chosen & (samples.matches[:, 0] > 0) if matched else chosen
    return float(np.quantile(samples.light[use], share))


def _range(samples: _Samples, chosen: np.ndarray) -> float:
    """Log luminance between the darkest and the brightest tenth of chosen samples (N,)."""
    return _quantile(samples, chosen, 0.9) - _quantile(samples, chosen, 0.1)


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
