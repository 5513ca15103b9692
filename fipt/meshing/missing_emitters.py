"""Round lamps that a mesh lacks: spheres where the views' rays through bright spots meet, before the surface.

A scan or a mesh of photographs often has no bulb: it is small, bright and has no texture. Its light then falls on the
surface behind it, and the room is dark. A sphere that emits the same in all directions is told from all else by this:

- rays through spots of three or more views meet within a pixel;
- its intensity, irradiance times squared distance, is the same from all of them. An opening through which something
  bright is seen does not keep it, nor do spots that meet by chance;
- the mesh has nothing there, nor around it: it is no opening with a rim. A highlight on a flat or bulging surface seems
  to lie behind it;
- what lies behind is darker, as other views see it: it is no window between leaves that the mesh lacks;
- nearly all views that would see it do, as intense as it is. Things in the sun differ from side to side;
- it is far brighter than the surface around, and gives some of the light of the room. A candle or a cup that the mesh
  lacks, too, only reflects.

Radius r and radiance L come from the intensity I = pi r^2 L, with the largest radiance that a view shows for L. Of a
lamp that fills no pixel, r is an upper bound then, and its light is right all the same.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from fipt.conventions import LUMINANCE
from fipt.meshing.bright_spots import Spots, bright_spots
from fipt.meshing.radiance_edges import Radiance, reduced_view
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

log = logging.getLogger(__name__)

_SPOTS, _FEWEST_SPOTS = 2000, 8
"""Spots of all views together that are compared at most, and of each view at least."""
_VIEWS = 3
"""That must show it: two rays meet somewhere by chance."""
_PIXELS = 1.0
"""By which a ray may miss the place."""
_INTENSITY = 1.3
"""Ratio of intensities that are the same. Bulbs of five rooms have a spread of 1 to 15 %, openings and spots that meet
by chance one of 20 to 35 %."""
_PARALLAX = 0.05
"""Least sine of the angle between two rays: those of less meet nowhere in particular."""
_NEAREST = 0.1
"""Metres before a camera."""
_POINTING = 0.5
"""Standard deviation of a spot's direction, pixels."""
_SIGMAS = 3.0
"""Errors of the place by which it must lie before the surface."""
_RAYS, _AROUND_PIXELS = 16, 2.0
"""Rays around a sphere, and pixels by which they pass it."""
_RIM = 0.25
"""Share of them that meet something: more may be the rim of an opening, a lamp's holder is less."""
_DARK = 0.25
"""Of the radiance that a view should show there: below it the view does not see the lamp."""
_DENIED = 3
"""Views that must show it for each that denies it."""
_TIMES = 3.0
"""It must be so many times as bright as what lies behind."""
_BLURRED = 3.0
"""Pixels beside a sphere that still have some of its light."""
_OUTSIDE = 1.1
"""Radii from its centre, at least, at which cameras stand."""
_AROUND = 1.0
"""Metres around it, in which surface is as well lit."""
_BRIGHTER = 10.0
"""Than the median of that surface it must be: white paint is by that much brighter than nearly black paint."""
_RELEVANT = 2e-3
"""Of the light of a typical place it must give: a thing that only reflects, and a pixel or two wide, gives less."""
_POINTS = 500
"""Pixels of a view that stand for its surface."""
_SUBDIVISIONS = 2
"""Of the icosahedron: 320 triangles."""


@dataclass(frozen=True)
class MissingEmitter:
    """A sphere: centre (3,) and radius, metres; how many views show it."""

    center: np.ndarray
    radius: float
    views: int


def missing_emitters(mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance) -> list[MissingEmitter]:
    """Find round lamps that the mesh lacks; Mitsuba's variant must be set.

    Parameters
    ----------
    cameras, radiance
        The training views, and what they show.
    """
    most = max(_SPOTS // max(len(cameras), 1), _FEWEST_SPOTS)
    spots = [bright_spots(*reduced_view(camera, radiance), view, most) for view, camera in enumerate(cameras)]
    if len(spots) < _VIEWS:
        return []
    scene, joined = RayScene(mesh), Spots.joined(spots)
    places = [_Meeting.of(own, scene) for own in _meetings(joined)]
    places = [place for place in places if place.free.sum() >= _VIEWS and not place.hidden.any()]
    if not places:
        return []
    denied, outshines = _asked(places, joined, scene, cameras, radiance)
    found = [
        MissingEmitter(place.center, place.radius, len(place.spots))
        for place, against, bright in zip(places, denied, outshines, strict=True)
        if bright and _DENIED * against <= len(place.spots)
    ]
    log.info("%d round lamps that the mesh lacks", len(found))
    return found


def with_spheres(mesh: Mesh, found: Sequence[MissingEmitter]) -> Mesh:
    """The mesh with a sphere for each; they have the mean cross section of the round ones."""
    import trimesh

    vertices, triangles = [mesh.vertices], [mesh.triangles]
    first = len(mesh.vertices)
    for sphere in found:
        ball = trimesh.creation.icosphere(_SUBDIVISIONS, 1.0)
        size = sphere.radius * np.sqrt(4 * np.pi / ball.area)
        vertices.append((ball.vertices * size + sphere.center).astype(np.float32))
        triangles.append((ball.faces + first).astype(np.int32))
        first += len(ball.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(triangles), seen_from=mesh.seen_from)


@dataclass(frozen=True)
class _Meeting:
    """Where rays of spots meet.

    Attributes
    ----------
    center, radius
        (3,) and of the sphere, metres.
    intensity
        Luminance times square metres: the median over the spots.
    peak
        Luminance of the brightest spot, beyond what is around.
    spots
        The spots (K,).
    free
        (K,) bool: the ray meets the mesh farther off than the sphere, and so do nearly all around it. Openings have a
        rim, and the sky shines itself.
    hidden
        (K,) bool: it meets the mesh before the sphere.
    behind
        (K, 3) where it meets the mesh; NaN where it does not.
    """

    center: np.ndarray
    radius: float
    intensity: float
    peak: float
    spots: Spots
    free: np.ndarray
    hidden: np.ndarray
    behind: np.ndarray

    @classmethod
    def of(cls, spots: Spots, scene: RayScene) -> "_Meeting":
        """What the mesh has along the rays of spots that meet."""
        center, across = _nearest(spots)
        distance = ((center - spots.center) * spots.direction).sum(axis=1)
        weight = (distance * spots.pixel * _POINTING) ** -2
        error = float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv((across * weight[:, None, None]).sum(axis=0))).max()))
        intensity, peak = float(np.median(spots.irradiance * distance**2)), float(spots.peak.max())
        radius = float(np.sqrt(intensity / (np.pi * peak)))
        met, _ = scene.intersect(spots.center.astype(np.float32), spots.direction.astype(np.float32))
        away = met.astype(np.float64) - distance
        margin = max(radius, _SIGMAS * error, float((distance * spots.pixel).max()))
        free = (away > margin) & np.isfinite(met) & ~_enclosed(spots, distance, radius, margin, scene)
        behind = spots.center + np.where(np.isfinite(met), met, np.nan)[:, None] * spots.direction
        return cls(center, radius, intensity, peak, spots, free, away < -margin, behind)


def _enclosed(spots: Spots, distance: np.ndarray, radius: float, margin: float, scene: RayScene) -> np.ndarray:
    """(K,) bool: for each spot's ray, whether much of what is around the sphere is no farther off, or the sky."""
    across = np.cross(spots.direction, np.eye(3)[np.argmin(np.abs(spots.direction), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(spots.direction, across)
    wide = radius / distance + _AROUND_PIXELS * spots.pixel
    turn = 2 * np.pi * np.arange(_RAYS) / _RAYS
    ring = np.cos(turn)[:, None, None] * across + np.sin(turn)[:, None, None] * other
    directions = spots.direction + wide[:, None] * ring
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    origins = np.broadcast_to(spots.center, directions.shape).reshape(-1, 3)
    met, _ = scene.intersect(origins.astype(np.float32), directions.reshape(-1, 3).astype(np.float32))
    met = met.reshape(_RAYS, -1)
    return ((met < distance + margin) | ~np.isfinite(met)).mean(axis=0) > _RIM


def _meetings(spots: Spots) -> list[Spots]:
    """Spots of three or more views, one of each, whose rays meet and whose intensities agree; no spot twice."""
    found: list[tuple[int, float, np.ndarray]] = []
    groups: list[set[int]] = [set() for _ in range(len(spots))]
    for first in range(len(spots)):
        for second in _partners(spots, first).tolist():
            if groups[first] & groups[second]:
                continue  # the same place
            own, miss = _together(spots, np.array([first, second]))
            if len(own) >= _VIEWS:
                for index in {first, second, *own.tolist()}:
                    groups[index].add(len(found))
                found.append((len(own), -miss, own))
    found.sort(key=lambda meeting: meeting[:2], reverse=True)
    taken, chosen = np.zeros(len(spots), bool), []
    for _, _, own in found:
        if not taken[own].any():
            taken[own] = True
            chosen.append(spots[own])
    return chosen


def _partners(spots: Spots, first: int) -> np.ndarray:
    """(M,) later spots of other views that one may be the same as: rays meet, and intensities there agree."""
    others = np.flatnonzero(spots.view > spots.view[first])
    offset, toward = spots.center[others] - spots.center[first], spots.direction[others]
    cosine = toward @ spots.direction[first]
    along, against = offset @ spots.direction[first], (offset * toward).sum(axis=1)
    square = np.maximum(1 - cosine**2, 1e-12)
    near = (along - cosine * against) / square  # distances along both rays to where they are nearest
    far = (cosine * along - against) / square
    between = near[:, None] * spots.direction[first] - offset - far[:, None] * toward
    allowed = _PIXELS * (near * spots.pixel[first] + far * spots.pixel[others])
    ratio = spots.irradiance[others] * far**2 / (spots.irradiance[first] * near**2 + 1e-30)
    sound = (square > _PARALLAX**2) & (np.minimum(near, far) > _NEAREST)
    sound &= (ratio < _INTENSITY) & (ratio > 1 / _INTENSITY)
    return others[sound & (np.linalg.norm(between, axis=1) < allowed)]


def _together(spots: Spots, pair: np.ndarray) -> tuple[np.ndarray, float]:
    """(K,) spots, one of a view, whose rays pass where those of two meet, as intense there; mean miss in pixels."""
    distance, off = _passing(spots, _nearest(spots[pair])[0])
    intensity = spots.irradiance * distance**2
    ratio = intensity / np.sqrt(intensity[pair].prod())
    own = np.flatnonzero((distance > _NEAREST) & (off < _PIXELS) & (ratio < _INTENSITY) & (ratio > 1 / _INTENSITY))
    own = own[np.argsort(off[own], kind="stable")]
    own = own[np.unique(spots.view[own], return_index=True)[1]]
    return own, float(off[own].mean()) if len(own) else 0.0


def _passing(spots: Spots, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances along the rays of spots at which they pass a place, and (N,) by how many pixels."""
    distance = ((place - spots.center) * spots.direction).sum(axis=1)
    off = np.linalg.norm(place - spots.center - distance[:, None] * spots.direction, axis=1)
    return distance, off / (np.maximum(distance, _NEAREST) * spots.pixel)


def _nearest(spots: Spots) -> tuple[np.ndarray, np.ndarray]:
    """(3,) the place nearest to the rays of spots, and (K, 3, 3) what projects across each."""
    across = np.eye(3) - spots.direction[:, :, None] * spots.direction[:, None]
    right = (across @ spots.center[:, :, None]).sum(axis=0)[:, 0]
    return np.linalg.solve(across.sum(axis=0), right), across


def _asked(
    places: Sequence[_Meeting], spots: Spots, scene: RayScene, cameras: Sequence[Camera], radiance: Radiance
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) how many views deny a lamp at each place; (P,) bool: it outshines what is around."""
    centers, radii = np.array([place.center for place in places]), np.array([place.radius for place in places])
    behind = _Behind.of(places)
    surface, denied = [], np.zeros(len(places), int)
    for view, camera in enumerate(cameras):
        camera, shown, valid = reduced_view(camera, radiance)
        luminance = shown @ LUMINANCE
        around = maximum_filter(luminance, 3)
        behind.ask(view, camera, around, valid, scene)
        pixel, distance = _visible(centers, radii, camera, valid, scene)
        own = spots[spots.view == view]
        for index in np.flatnonzero(pixel >= 0).tolist():
            place = places[index]
            if view not in place.spots.view:
                expected = min(place.intensity / distance[index] ** 2 * camera.fx * camera.fy, place.peak)
                denied[index] += around.flat[pixel[index]] < _DARK * expected or _points_at(own, place.center)
        inside = np.linalg.norm(centers - camera.center, axis=1) < _OUTSIDE * radii
        denied += len(cameras) * inside
        surface.append(_some_surface(camera, luminance, valid, scene))
    return denied + behind.bright(), _outshining(places, np.concatenate(surface))


def _points_at(spots: Spots, place: np.ndarray) -> bool:
    """Whether the ray of one of a view's spots passes a place: what shines there has another intensity in that view."""
    distance, off = _passing(spots, place)
    return bool(((distance > _NEAREST) & (off < _PIXELS)).any())


class _Behind:
    """What lies behind places, as other views see it.

    Parameters
    ----------
    places
        P meetings.
    row
        (N,) place of each ray.
    points
        (N, 3) where the rays meet the mesh behind the places.
    """

    def __init__(self, places: Sequence[_Meeting], row: np.ndarray, points: np.ndarray) -> None:
        self.places, self.row, self.points = places, row, points
        self.view = np.concatenate([place.spots.view[place.free] for place in places])
        self.seen: list[list[float]] = [[] for _ in row]

    @classmethod
    def of(cls, places: Sequence[_Meeting]) -> "_Behind":
        """Of the rays that pass freely."""
        row = np.repeat(np.arange(len(places)), [int(place.free.sum()) for place in places])
        return cls(places, row, np.concatenate([place.behind[place.free] for place in places]))

    def ask(self, view: int, camera: Camera, around: np.ndarray, valid: np.ndarray, scene: RayScene) -> None:
        """Note what a view shows there, (H, W) luminance, where no lamp at the place would stand before it."""
        pixel, _ = _visible(self.points, np.zeros(len(self.row)), camera, valid, scene)
        toward = self.points - camera.center
        toward = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
        offset = np.array([self.places[k].center for k in self.row]) - camera.center
        along = (offset * toward).sum(axis=1)
        away = np.linalg.norm(offset - along[:, None] * toward, axis=1)
        radii = np.array([self.places[k].radius for k in self.row])
        clear = (away > radii + _BLURRED * np.abs(along) / camera.fx) & (self.view != view)
        for index in np.flatnonzero((pixel >= 0) & clear).tolist():
            self.seen[index].append(float(around.flat[pixel[index]]))

    def bright(self) -> np.ndarray:
        """(P,) int rays behind which two views see something as bright as a lamp would be.

        All others may not see it: what the mesh lacks stands before it.
        """
        second = np.array([sorted(seen)[-2] if len(seen) > 1 else 0.0 for seen in self.seen])
        peak = np.array([place.peak for place in self.places])[self.row]
        return np.bincount(self.row, _TIMES * second >= peak, len(self.places)).astype(int)


def _some_surface(camera: Camera, luminance: np.ndarray, valid: np.ndarray, scene: RayScene) -> np.ndarray:
    """(N, 4) place and luminance of evenly some pixels of a view."""
    step = max(int(np.sqrt(luminance.size / _POINTS)), 1)
    rows, columns = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
    directions = camera.directions(columns + 0.5, rows + 0.5).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center.astype(np.float32), directions)
    rows, columns = rows.ravel(), columns.ravel()
    met = (triangle >= 0) & (valid[rows, columns] > 0)
    places = camera.center + distance[met, None].astype(np.float64) * directions[met]
    return np.column_stack([places, luminance[rows[met], columns[met]]])


def _outshining(places: Sequence[_Meeting], surface: np.ndarray) -> np.ndarray:
    """(P,) bool: brighter than what is around, and light for the room; surface is (N, 4) places and luminance."""
    result = np.zeros(len(places), bool)
    if not len(surface):
        return result
    for index, place in enumerate(places):
        distance = np.maximum(np.linalg.norm(surface[:, :3] - place.center, axis=1), place.radius)
        near = distance < max(_AROUND, float(np.sort(distance)[min(_POINTS, len(distance) - 1)]))
        share = place.intensity / (np.pi * np.maximum(surface[:, 3], 1e-9) * distance**2)
        result[index] = place.peak > _BRIGHTER * np.median(surface[near, 3]) and np.median(share) > _RELEVANT
    return result


def _visible(
    centers: np.ndarray, radii: np.ndarray, camera: Camera, valid: np.ndarray, scene: RayScene
) -> tuple[np.ndarray, np.ndarray]:
    """Where a view shows spheres, if they are there: the mesh has nothing before them.

    Returns
    -------
    pixel
        (P,) int64 row by row; -1 where it does not.
    distance
        (P,) from the camera, metres.
    """
    image, depth = camera.project(centers)
    column, row = np.floor(image).astype(np.int64).T
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    inside[inside] = valid[row[inside], column[inside]] > 0
    toward = centers - camera.center
    distance = np.maximum(np.linalg.norm(toward, axis=1), _NEAREST)
    met, _ = scene.intersect(camera.center.astype(np.float32), (toward / distance[:, None]).astype(np.float32))
    near = distance * (1 - 0.5 / camera.fx) - radii  # a place on the mesh is half a pixel before it, or behind
    return np.where(inside & (met > near), row * camera.width + column, -1), distance
