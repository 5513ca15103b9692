"""Round lamps that a mesh lacks: spheres where the views' rays through bright spots meet, before the surface.

A scan or a mesh of photographs often has no bulb: it is small, bright and has no texture. Its light then falls on the
surface behind it, and the room is dark. A sphere that emits the same in all directions is told from all else by this:

- rays through spots of three or more views meet within a pixel, or of two, if three other lamps have its intensity;
- its intensity, irradiance times squared distance, is the same from all of them. An opening through which something
  bright is seen does not keep it, nor do spots that meet by chance;
- the mesh has nothing there, nor around it: it is no opening with a rim. A highlight on a flat or bulging surface seems
  to lie behind it. A scan may have scraps of it there: what is as thin as the distance by which fusion displaces
  surface comes out in part, too wide or open. They are taken out;
- what lies behind is darker, as other views see it: it is no window between leaves that the mesh lacks;
- nearly all views that would see it do, as intense as it is. Things in the sun differ from side to side. Where the mesh
  has scraps they need not agree: an arm of a chandelier, which the mesh lacks, too, hides a part of a bulb;
- it is far brighter than the surface around, and gives some of the light of the room. A candle or a cup that the mesh
  lacks, too, only reflects.

Radius r and radiance L come from the intensity I = pi r^2 L. L is the median of the levels of spots in which the lamp
fills some pixels. Of a lamp that fills no pixel, L is that of others as intense, as lamps come in sets; else the
largest radiance that a view shows, and r is an upper bound. Its light is right all the same.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.ndimage import maximum_filter

from fipt.conventions import LUMINANCE
from fipt.meshing.bright_spots import Spots, bright_spots
from fipt.meshing.radiance_edges import Radiance, reduced_view
from fipt.meshing.spot_meetings import INTENSITY, NEAREST, PIXELS, VIEWS, alike, alike_pairs, meetings, nearest, passing
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

log = logging.getLogger(__name__)

_SPOTS, _FEWEST_SPOTS = 2000, 8
"""Spots of all views together that are compared at most, and of each view at least."""
_POINTING = 0.5
"""Standard deviation of a spot's direction, pixels."""
_SIGMAS = 3.0
"""Errors of the place by which it must lie before the surface."""
_FILLED = 4.0
"""Area of a lamp, pixels, from which on it fills nine tenths of one wherever it lies."""
_OVERSHOOT = 2.0
"""Of the brightest pixel of a spot over its lamp: denoised pictures have up to 1.6 times as much."""
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
_THIN = 2.0
"""Radius of the largest lamp that a scan has in scraps, in distances by which fusion displaces surface: of larger ones
it has the shape."""
_WIDER = 0.25
"""Of that distance, by which scraps are wider than the lamp at most, in the median of the views: a shade, or a thing
that mirrors a lamp, is larger than what shines."""
_REACH = 1.5
"""Of the distance from a lamp's centre up to which its scraps lie: none has a corner farther off, but a wall may."""
_AREA_RAYS, _GOLDEN = 256, np.pi * (3 - np.sqrt(5))
"""Rays that measure how wide they are, and the angle from one to the next of a sunflower's seeds."""
_SUBDIVISIONS = 2
"""Of the icosahedron: 320 triangles."""


@dataclass(frozen=True)
class MissingEmitter:
    """A sphere: centre (3,) and radius, metres; how many views show it.

    What lies within ``scraps`` metres of the centre is taken out of the mesh; 0 where the mesh has nothing of the lamp.
    """

    center: np.ndarray
    radius: float
    views: int
    scraps: float = 0.0


def missing_emitters(
    mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance, blur: float = 0.0
) -> list[MissingEmitter]:
    """Find round lamps that the mesh lacks, or has in scraps; Mitsuba's variant must be set.

    Parameters
    ----------
    cameras, radiance
        The training views, and what they show.
    blur
        By how much fusion displaces the surface of thin things, metres; 0 for a mesh that is no scan.
    """
    most = max(_SPOTS // max(len(cameras), 1), _FEWEST_SPOTS)
    spots = [bright_spots(*reduced_view(camera, radiance), view, most) for view, camera in enumerate(cameras)]
    if len(spots) < VIEWS:
        return []
    judged = partial(_emitting, mesh, Spots.joined(spots), cameras, radiance, blur)
    places = _distinct(judged(meetings(Spots.joined(spots))))
    known = np.array([own.center for own in places]).reshape(-1, 3), np.array([own.intensity for own in places])
    places = _distinct(places + judged(alike_pairs(Spots.joined(spots), *known)))
    places = [place.like_others(places) for place in places]
    log.info("%d round lamps that the mesh lacks, or has in scraps", len(places))
    return [MissingEmitter(place.center, place.radius, len(place.spots), place.scraps) for place in places]


def _emitting(
    mesh: Mesh, spots: Spots, cameras: Sequence[Camera], radiance: Radiance, blur: float, met: Sequence[Spots]
) -> list["_Meeting"]:
    """Of the places where some ``spots`` meet those that are lamps."""
    if not met:
        return []
    places, scene = _places(mesh, met, blur)
    if not places:
        return []
    denied, outshines = _asked(places, spots, scene, cameras, radiance)
    sound = outshines & (_DENIED * denied <= [len(place.spots) for place in places])
    return [place for place, own in zip(places, sound, strict=True) if own]


def _distinct(places: Sequence["_Meeting"]) -> list["_Meeting"]:
    """Places without those within a brighter one: views meet there of which something hides a part of it."""
    result: list[_Meeting] = []
    for place in sorted(places, key=lambda place: -place.intensity):
        if all(np.linalg.norm(place.center - own.center) > own.radius + place.radius for own in result):
            result.append(place)
    return result


def with_spheres(mesh: Mesh, found: Sequence[MissingEmitter]) -> Mesh:
    """The mesh with a sphere for each in place of its scraps; they have the mean cross section of the round ones."""
    import trimesh

    vertices, triangles = [mesh.vertices], [mesh.triangles[~_within(mesh, found)]]
    first = len(mesh.vertices)
    for sphere in found:
        ball = trimesh.creation.icosphere(_SUBDIVISIONS, 1.0)
        size = sphere.radius * np.sqrt(4 * np.pi / ball.area)
        vertices.append((ball.vertices * size + sphere.center).astype(np.float32))
        triangles.append((ball.faces + first).astype(np.int32))
        first += len(ball.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(triangles), seen_from=mesh.seen_from)


def _within(mesh: Mesh, places: Sequence["MissingEmitter | _Meeting"]) -> np.ndarray:
    """(T,) bool: triangles that lie among the scraps at any of some places."""
    result, corners = np.zeros(len(mesh.triangles), bool), mesh.corners
    middle = corners.mean(axis=1)
    for place in places:
        near = np.flatnonzero(np.linalg.norm(middle - place.center, axis=1) < place.scraps)
        reach = np.linalg.norm(corners[near] - place.center, axis=2).max(axis=1, initial=0)
        result[near[reach < _REACH * place.scraps]] = True
    return result


def _places(mesh: Mesh, met: Sequence[Spots], blur: float) -> tuple[list["_Meeting"], RayScene]:
    """Places where rays of spots meet and the mesh has nothing but scraps, and the mesh without these."""
    whole = scene = RayScene(mesh)
    places = [_Meeting.of(own, whole) for own in met]
    scraps = [place for place in (own.with_scraps(whole, blur) for own in places) if place.scraps]
    if scraps:
        scene = RayScene(Mesh(mesh.vertices, mesh.triangles[~_within(mesh, scraps)], seen_from=mesh.seen_from))
        without = {id(place.spots): _Meeting.of(place.spots, scene, place.scraps) for place in scraps}
        places = [without.get(id(place.spots), place) for place in places]
    return [place for place in places if place.lacking], scene


@dataclass(frozen=True)
class _Meeting:
    """Where rays of spots meet.

    Attributes
    ----------
    center
        (3,) of the sphere, metres.
    intensity
        Luminance times square metres: the median over the spots.
    peak
        Luminance of the lamp, beyond what is around: of spots in which it fills a pixel; if there is none, of the
        brightest spot.
    resolved
        Whether there is one.
    spots
        The spots (K,).
    free
        (K,) bool: the ray meets the mesh farther off than the sphere, and so do nearly all around it. Openings have a
        rim, and the sky shines itself.
    hidden
        (K,) bool: it meets the mesh before the sphere.
    behind
        (K, 3) where it meets the mesh; NaN where it does not.
    scraps
        Metres from the centre to which the mesh may have scraps of it.
    """

    center: np.ndarray
    intensity: float
    peak: float
    resolved: bool
    spots: Spots
    free: np.ndarray
    hidden: np.ndarray
    behind: np.ndarray
    scraps: float = 0.0

    @classmethod
    def of(cls, spots: Spots, scene: RayScene, scraps: float = 0.0) -> "_Meeting":
        """What the mesh has along the rays of spots that meet."""
        center, across = nearest(spots)
        distance = ((center - spots.center) * spots.direction).sum(axis=1)
        weight = (distance * spots.pixel * _POINTING) ** -2
        error = float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv((across * weight[:, None, None]).sum(axis=0))).max()))
        intensity, peak = float(np.median(spots.irradiance * distance**2)), float(spots.peak.max())
        filled = intensity / peak >= _FILLED * (distance * spots.pixel) ** 2
        if filled.any():  # the brightest pixel of all views is one that noise has made so
            peak = float(np.median(spots.level[filled]))
        radius = np.sqrt(intensity / (np.pi * peak))
        met, _ = scene.intersect(spots.center.astype(np.float32), spots.direction.astype(np.float32))
        away = met.astype(np.float64) - distance
        margin = float(max(radius, _SIGMAS * error, (distance * spots.pixel).max()))
        free = (away > margin) & np.isfinite(met) & ~_enclosed(spots, distance, radius, margin, scene)
        behind = spots.center + np.where(np.isfinite(met), met, np.nan)[:, None] * spots.direction
        return cls(center, intensity, peak, bool(filled.any()), spots, free, away < -margin, behind, scraps)

    @property
    def radius(self) -> float:
        """Of the sphere, metres."""
        return float(np.sqrt(self.intensity / (np.pi * self.peak)))

    @property
    def lacking(self) -> bool:
        """Whether the mesh has nothing there."""
        return bool(self.free.sum() >= min(VIEWS, len(self.free)) and not self.hidden.any())

    def like_others(self, emitting: Sequence["_Meeting"]) -> "_Meeting":
        """The place with the luminance of others as intense of which views tell it, if none tells its own.

        Noise and denoisers make its brightest pixel brighter than it is, but not more than `_OVERSHOOT` times.
        """
        same = [
            own.peak
            for own in emitting
            if own.resolved and alike(own.intensity, self.intensity) and self.peak < _OVERSHOOT * own.peak
        ]
        return self if self.resolved or not same else replace(self, peak=float(np.median(same)))

    def with_scraps(self, scene: RayScene, blur: float) -> "_Meeting":
        """The place with its scraps, if the mesh has such there: as wide as the lamp, and with nothing around."""
        scraps = self.radius + blur
        if self.radius > _THIN * blur:
            return self
        spots = self.spots
        distance = ((self.center - spots.center) * spots.direction).sum(axis=1)
        alone = ~_enclosed(spots, distance, scraps, scraps, scene)
        if alone.sum() < max(min(VIEWS, len(alone)), (1 - _RIM) * len(alone)):
            return self
        turn, off = _GOLDEN * np.arange(_AREA_RAYS), np.sqrt((np.arange(_AREA_RAYS) + 0.5) / _AREA_RAYS)
        directions = _beside(spots, off[:, None] * scraps / distance, turn)
        place = spots.center + _met(spots, directions, scene)[..., None] * directions
        near = np.linalg.norm(place - self.center, axis=2) < scraps
        area = np.pi * scraps**2 * float(np.median(near.mean(axis=0)))
        sound = 0 < area < np.pi * (self.radius + _WIDER * blur) ** 2
        return replace(self, scraps=scraps) if sound else self


def _enclosed(spots: Spots, distance: np.ndarray, radius: float, margin: float, scene: RayScene) -> np.ndarray:
    """(K,) bool: for each spot's ray, whether much of what is around the sphere is no farther off, or the sky."""
    wide = np.tile(radius / distance + _AROUND_PIXELS * spots.pixel, (_RAYS, 1))
    met = _met(spots, _beside(spots, wide, 2 * np.pi * np.arange(_RAYS) / _RAYS), scene)
    return ((met < distance + margin) | ~np.isfinite(met)).mean(axis=0) > _RIM


def _beside(spots: Spots, off: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(R, K, 3) unit vectors off those of K spots, by the tangents of angles (R, K), toward R sides ``turn``."""
    across = np.cross(spots.direction, np.eye(3)[np.argmin(np.abs(spots.direction), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(spots.direction, across)
    ring = np.cos(turn)[:, None, None] * across + np.sin(turn)[:, None, None] * other
    directions = spots.direction + off[..., None] * ring
    return directions / np.linalg.norm(directions, axis=2, keepdims=True)


def _met(spots: Spots, directions: np.ndarray, scene: RayScene) -> np.ndarray:
    """(R, K) distance to what rays along directions (R, K, 3) from the cameras of K spots meet; inf for nothing."""
    origins = np.broadcast_to(spots.center, directions.shape).reshape(-1, 3)
    met, _ = scene.intersect(origins.astype(np.float32), directions.reshape(-1, 3).astype(np.float32))
    return met.reshape(directions.shape[:2]).astype(np.float64)


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
                # where the mesh has scraps, too little light is that of a lamp of which something hides a part
                other = _points_at(own, place.center, INTENSITY * place.intensity if place.scraps else 0.0)
                denied[index] += around.flat[pixel[index]] < _DARK * expected or other
        inside = np.linalg.norm(centers - camera.center, axis=1) < _OUTSIDE * radii
        denied += len(cameras) * inside
        surface.append(_some_surface(camera, luminance, valid, scene))
    return denied + behind.bright(), _outshining(places, np.concatenate(surface))


def _points_at(spots: Spots, place: np.ndarray, above: float) -> bool:
    """Whether the ray of a view's spot passes a place with an intensity ``above`` another: it is not the same lamp."""
    distance, off = passing(spots, place)
    return bool(((distance > NEAREST) & (off < PIXELS) & (spots.irradiance * distance**2 > above)).any())


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
    distance = np.maximum(np.linalg.norm(toward, axis=1), NEAREST)
    met, _ = scene.intersect(camera.center.astype(np.float32), (toward / distance[:, None]).astype(np.float32))
    near = distance * (1 - 0.5 / camera.fx) - radii  # a place on the mesh is half a pixel before it, or behind
    return np.where(inside & (met > near), row * camera.width + column, -1), distance
