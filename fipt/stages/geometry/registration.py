"""A scan in coordinates of its own, brought to the cameras: by the depth that the views show."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from fipt.child import run_in_child
from fipt.errors import FiptError
from fipt.scene.mesh import Mesh, surface_points
from fipt.stages.geometry.closest_fit import closest_fit
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.room_directions import cube_turns

log = logging.getLogger(__name__)

_POINTS = 8_000
"""Points of the views, and some times as many of the scan."""
REACH = 0.05
"""Metres from the scan within which a point of a view fits it: depth from parallax is known to a few centimetres."""
_LEAST = 0.6
"""Share of the points that must fit, of the mean of three directions: another room shares one of them at best."""
_WELL = 0.8
"""Share below which a warning is given."""
_RIVAL = 0.98
"""A second place of the scan with this share of the best one's points is as good: shares are known to a percent."""
_SAME_PLACE = (np.cos(np.radians(10.0)), 0.3)
"""Cosine of the angle and metres within which two places of the scan are one."""
_FACES = np.cos(np.radians(20.0))
"""Cosine within which a normal is along a direction."""
_FACED = 0.01
"""Share of the points that face a direction, from which on these alone tell places along it."""
_BIN = 0.05
"""Metres that are one place along a direction, at first."""
_PEAKS = 3
"""Shifts that are tried along each direction."""
_TRIED = 6
"""Best places that are refined."""
_LARGER = 4.0
"""Factor of size by which a scan of the room may differ from what the views show: they show a part, or it is one."""
_UNITS = (1e-3, 1e-2, 0.0254, 0.1, 0.3048, 1.0, 10.0, 100.0, 1000.0)
"""Metres of a unit that scans come in."""
_SECONDS = 300.0


@dataclass(frozen=True)
class _FacingPoints:
    """Points with unit normals, metres: (N, 3) float64 each."""

    points: np.ndarray
    normals: np.ndarray

    @property
    def directions(self) -> np.ndarray:
        """(3, 3) float64 the three directions, at right angles, that most of it faces; rows, a right-handed frame."""
        some = self.normals[:: max(1, len(self.normals) // 2000)]
        along = np.abs(some @ some.T) > _FACES
        first = _mean_direction(some, along[along.sum(axis=1).argmax()])
        level = np.abs(some @ first) < np.sin(np.radians(20.0))
        votes = (along & level[:, None] & level[None]).sum(axis=1)
        second = _mean_direction(some, along[votes.argmax()] & level)
        u, _, v = np.linalg.svd(np.array([first, second, np.cross(first, second)]))
        return u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v

    def heights(self, directions: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Places along each direction, metres: of all points, and of those that face it, either way."""
        along, facing = self.points @ directions.T, np.abs(self.normals @ directions.T) > _FACES
        return [(along[:, axis], along[facing[:, axis], axis]) for axis in range(3)]


class _ScanPlace:
    """A place of the scan, and how well it fits.

    Attributes
    ----------
    share
        Of the points of the room within `REACH` of the scan: the mean over those that face each of its directions, as
        any wall fits some other.
    residual
        Median distance of these to the tangent planes of the scan, metres.
    """

    def __init__(self, room: _FacingPoints, scan: _FacingPoints, scan_from_world: np.ndarray) -> None:
        from scipy.spatial import cKDTree

        self.scan_from_world = scan_from_world
        moved = _moved(room.points, scan_from_world)
        distance, nearest = cKDTree(scan.points).query(moved, distance_upper_bound=REACH)
        near = np.isfinite(distance)
        facing = np.abs(room.normals @ room.directions.T).argmax(axis=1)
        count, fits = np.bincount(facing, minlength=3), np.bincount(facing, near, 3)
        faced = count > _FACED * len(facing)
        self.share = float((fits[faced] / count[faced]).mean())
        off = ((moved[near] - scan.points[nearest[near]]) * scan.normals[nearest[near]]).sum(axis=1)
        self.residual = float(np.median(np.abs(off))) if near.any() else np.inf


def registered(
    scan: Mesh,
    views: Sequence[DepthView],
    origin: np.ndarray | None = None,
    world_origin: np.ndarray | None = None,
    unit: float = 1.0,
    seed: int = 0,
) -> tuple[Mesh, dict[str, Any]]:
    """Bring a scan to the cameras of views with depth.

    Where it lies already is tried first; then every turn by 90 degrees that brings the directions of the scan to those
    of the room, with the shifts at which most of the surface meets.

    Parameters
    ----------
    scan
        Near the origin: positions are float32.
    views
        With depth maps.
    origin
        (3,) float64 metres that were subtracted from the scan's own coordinates; None: nothing was.
    world_origin
        (3,) float64 metres that were subtracted from the coordinates of the cameras' source; None: nothing was.
    unit
        Metres that were taken for a unit of the scan.
    seed
        Of the points that are compared.

    Returns
    -------
    mesh
        The scan in the world of the cameras, near the origin.
    about
        ``world_from_scan`` for the scan's own coordinates in metres, ``share`` of the points of the views within
        `REACH` of it, the mean over the room's three directions, ``residual_mm``, the median distance of these,
        ``turned`` degrees, ``moved`` metres from its own coordinates to those of the cameras' source, ``warnings``.

    Raises
    ------
    FiptError
        If it fits nowhere: another room, another unit, or depth that is wrong.
    """
    rng = np.random.default_rng(seed)
    origin, world_origin = (np.zeros(3) if each is None else each for each in (origin, world_origin))
    room, other = _of_views(views, rng), _of_scan(scan, rng)
    _check_size(room, other, unit)
    places = _refined(room, other, origin - world_origin)
    best = max(places, key=lambda place: place.share)
    if best.share < _LEAST:
        raise FiptError(
            f"the scan must show what the views show: in its best place {best.share:.0%} of their depth lies within "
            f"{100 * REACH:.0f} cm of it",
            "check that it is of this room, and look at the depth maps",
        )
    mesh = Mesh(_moved(scan.vertices, np.linalg.inv(best.scan_from_world)).astype(np.float32), scan.triangles)
    middle = room.points.mean(axis=0)
    return mesh, _about(best, _warnings(places, best, middle), middle, origin, world_origin)


def _refined(room: _FacingPoints, scan: _FacingPoints, offset: np.ndarray) -> list[_ScanPlace]:
    """Places of the scan that are worth a look, as close as its surface comes to the room's points.

    ``offset`` is the scan's origin less that of the cameras, (3,) metres.
    """
    starts = _starts(room, scan, offset)
    arguments = {"points": room.points, "surface": scan.points, "normals": scan.normals, "starts": starts}
    # one CPU: sums over several threads differ in their last bits
    result = run_in_child(closest_fit, {**arguments, "reach": REACH}, _SECONDS, cpus=1)
    return [_ScanPlace(room, scan, found) for found in result["found"]]


def _warnings(places: Sequence[_ScanPlace], best: _ScanPlace, middle: np.ndarray) -> list[str]:
    """What speaks against the best place; ``middle`` (3,) of the room, metres."""
    warnings = []
    if best.share < _WELL:
        warnings.append(f"the scan lies within {100 * REACH:.0f} cm of {best.share:.0%} of what the views show")
    rivals = [place for place in places if place.share > _RIVAL * best.share]
    if not all(_alike(place.scan_from_world, best.scan_from_world, middle) for place in rivals):
        warnings.append("the scan fits the views as well in another place: the room looks alike from several sides")
    return warnings


def _about(
    best: _ScanPlace, warnings: list[str], middle: np.ndarray, origin: np.ndarray, world_origin: np.ndarray
) -> dict[str, Any]:
    """What is said of the place that was found, as `registered` returns it; logged, too."""
    world_from_scan = np.linalg.inv(best.scan_from_world)
    turn = world_from_scan[:3, :3]
    world_from_scan[:3, 3] -= turn @ origin
    way = middle + world_origin - _moved(middle, best.scan_from_world) - origin
    about = {
        "world_from_scan": np.round(world_from_scan, 12).tolist(),  # coordinates of a map have millions of metres
        "share": round(best.share, 4),
        "residual_mm": round(1e3 * best.residual, 2),
        "turned": round(float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))), 3),
        "moved": round(float(np.linalg.norm(way)), 4),
        "warnings": warnings,
    }
    log.info("the scan was turned by %.1f degrees and moved by %.2f m; %.0f %% of what the views show lies within "
             "%.0f cm of it, at a median distance of %.1f mm",
             about["turned"], about["moved"], 100 * best.share, 100 * REACH, about["residual_mm"])  # fmt: skip
    for warning in warnings:
        log.warning("%s: look at it in the report", warning)
    return about


def _of_views(views: Sequence[DepthView], rng: np.random.Generator) -> _FacingPoints:
    known = [view.map.known & (view.map.normal**2).sum(axis=-1).astype(bool) for view in views]
    points = np.concatenate([view.points[k] for view, k in zip(views, known, strict=True)])
    normals = np.concatenate([view.map.normal[k] for view, k in zip(views, known, strict=True)])
    if len(points) < 100:
        raise FiptError("the depth maps must hold depth, to bring a scan to them; next to none is known",
                        "give a mesh in the coordinates of the cameras")  # fmt: skip
    some = rng.choice(len(points), min(_POINTS, len(points)), replace=False)
    return _FacingPoints(points[some].astype(np.float64), normals[some].astype(np.float64))


def _of_scan(scan: Mesh, rng: np.random.Generator) -> _FacingPoints:
    """Points of a scan by area: as many as are needed for one in a square of half the reach, a million at most."""
    spacing = max(REACH / 2, float(np.sqrt(scan.areas.sum() / 1e6)))
    seed = int(rng.integers(2**31))
    points, triangle = surface_points(scan, spacing, *_everywhere(scan), seed)
    normals = scan.normals[triangle]
    whole = (normals**2).sum(axis=1) > 0
    if not whole.any():
        raise FiptError("the scan must have a surface; all of its triangles are without area", "give another scan")
    return _FacingPoints(points[whole].astype(np.float64), normals[whole].astype(np.float64))


def _everywhere(scan: Mesh) -> tuple[np.ndarray, np.ndarray]:
    return scan.vertices.min(axis=0) - 1, scan.vertices.max(axis=0) + 1


def _starts(room: _FacingPoints, scan: _FacingPoints, offset: np.ndarray) -> np.ndarray:
    """(K, 4, 4) scan_from_world: as it is, and the places where most of the surface meets."""
    from scipy.spatial import cKDTree

    tree = cKDTree(scan.points)
    some = np.linspace(0, len(room.points) - 1, 500).astype(np.int64)
    points, normals = room.points[some], room.normals[some]
    place, facing = room.directions, scan.directions
    wanted = scan.heights(facing)
    as_it_is = np.eye(4)
    as_it_is[:3, 3] -= offset
    tried, met = [as_it_is], [np.inf]
    for turn in cube_turns():
        rotation = facing.T @ turn @ place
        there = _FacingPoints(room.points @ rotation.T, room.normals @ rotation.T).heights(facing)
        shifts = [_shifts(own, other) for own, other in zip(there, wanted, strict=True)]
        turned = points @ rotation.T
        for along in product(*shifts):
            shift = facing.T @ np.array(along)
            distance, nearest = tree.query(turned + shift, distance_upper_bound=4 * REACH)
            near = np.isfinite(distance)
            agree = np.abs(((normals @ rotation.T)[near] * scan.normals[nearest[near]]).sum(axis=1)) > _FACES
            start = np.eye(4)
            start[:3, :3], start[:3, 3] = rotation, shift
            tried.append(start)
            met.append(float(agree.sum()))
    return np.array(tried)[np.argsort(-np.array(met), kind="stable")[: 1 + _TRIED]]


def _shifts(own: tuple[np.ndarray, np.ndarray], wanted: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Shifts, metres, that bring most of some places onto others, along one direction.

    What faces it tells most; views that show neither floor nor ceiling have none.
    """
    faced = min(len(own[1]) / len(own[0]), len(wanted[1]) / len(wanted[0])) > _FACED
    pair = (own[1], wanted[1]) if faced else (own[0], wanted[0])
    low = [float(x.min()) for x in pair]  # each has its own: they may be far apart
    one, two = (np.bincount(((x - at) / _BIN).astype(np.int64)) / len(x) for x, at in zip(pair, low, strict=True))
    match = np.correlate(two, one, "full")
    return (np.argsort(-match, kind="stable")[:_PEAKS] - (len(one) - 1)) * _BIN + low[1] - low[0]


def _mean_direction(normals: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Unit direction that chosen normals have, whichever way they face."""
    own = normals[chosen]
    return np.linalg.eigh(own.T @ own)[1][:, -1]


def _moved(points: np.ndarray, transform: np.ndarray) -> np.ndarray:
    """(..., 3) points after a (4, 4) transform."""
    return points @ transform[:3, :3].T + transform[:3, 3]


def _alike(one: np.ndarray, other: np.ndarray, middle: np.ndarray) -> bool:
    """Whether two transforms bring the middle of the room to one place, the same way round."""
    cosine = (np.trace(one[:3, :3].T @ other[:3, :3]) - 1) / 2
    away = np.linalg.norm(_moved(middle, one) - _moved(middle, other))
    return bool(cosine > _SAME_PLACE[0] and away < _SAME_PLACE[1])


def _check_size(room: _FacingPoints, scan: _FacingPoints, unit: float) -> None:
    """Raise FiptError where the scan, its unit so many metres, is much larger or smaller than what the views show."""
    sizes = [
        np.sort(np.ptp(np.quantile(s.points @ s.directions.T, [0.02, 0.98], axis=0), axis=0)) for s in (room, scan)
    ]
    factor = float(np.median(sizes[0] / np.maximum(sizes[1], 1e-12)))
    if 1 / _LARGER < factor < _LARGER:
        return
    fitting = min(_UNITS, key=lambda other: abs(np.log(other / (factor * unit))))
    raise FiptError(
        f"the scan must be in metres; it is about {1 / factor:.3g} times as large as what the views show",
        f"set geometry.scan_unit: {fitting:g}, if its unit is that many metres; else check that it is of this room",
    )
