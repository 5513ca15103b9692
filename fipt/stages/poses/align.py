"""A reconstruction in metres, upright, with its walls along the axes and its floor at y = 0.

Cameras from pictures have no scale and stand anyhow. Metres come from a board in the room, from measured distances
between named points, or from the tripod's height over the floor; up from the board, the floor, or the cameras. All that
is known is compared; what was used, and how well the rest agrees, is in the `AlignReport`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.scene.cameras import Camera
from fipt.stages.poses.manhattan import find_walls
from fipt.stages.poses.model import Reconstruction
from fipt.stages.poses.room_boards import Placed, ReadImage, find_boards, place
from fipt.stages.poses.settings import Align
from fipt.stages.poses.triangulate import triangulate

_ASSUMED_HEIGHT = 1.5
"""Height of the cameras above the floor in metres that is assumed where nothing gives a scale."""

_PARALLAX = 1.0
"""Degrees between the rays of a named point, at least."""

_APART = 8.0
"""Pixels by which the rays of a named point may miss each other."""

_STEEPEST = 25.0
"""Degrees between the floor's normal and the cameras' mean up, at most."""

_FLOOR_TRIES = 2000
_FLOOR_SAMPLE = 5000
_MORE = 3.0
"""Points on the floor over those that any level slice of the walls would hold, at least."""

_FLAT = 0.004
"""Half the floor's thickness over the extent of the points."""


@dataclass(frozen=True)
class AlignReport:
    """What an alignment used and how well things agree; plain values.

    Attributes
    ----------
    scale
        ``source``, ``metres_per_unit``, ``deviation`` (relative), ``boards``, ``distances``, ``tripod``.
    up
        ``source`` and ``off_degrees``: name of each other estimate -> degrees from the one used.
    walls
        Fields of `fipt.stages.poses.manhattan.Walls`, and ``statement``; None where nothing was turned.
    floor
        ``source`` of the height 0, ``points`` on it and ``deviation`` in metres where it is a plane.
    warnings
        Sentences for people.
    """

    scale: dict[str, Any]
    up: dict[str, Any]
    walls: dict[str, Any] | None
    floor: dict[str, Any]
    warnings: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """Return the content as plain JSON types."""
        return asdict(self) | {"warnings": list(self.warnings)}


@dataclass(frozen=True)
class Plane:
    """The floor: n . x = offset with n upwards, (3,) unit vector.

    Attributes
    ----------
    normal, offset
        In units of the reconstruction.
    points
        Points on it.
    deviation
        Root mean square distance of these.
    """

    normal: np.ndarray
    offset: float
    points: int
    deviation: float


def align(reconstruction: Reconstruction, read_image: ReadImage, settings: Align) -> tuple[np.ndarray, AlignReport]:
    """Find the similarity that brings a reconstruction into metres, upright and along the walls.

    The result has y up, the floor at y = 0 under the middle of the cameras, which is x = z = 0, and the room's longer
    side along x; of the two ways that remain, the first camera looks towards -z.

    Parameters
    ----------
    reconstruction
        Cameras and points.
    read_image
        Linear radiance of a view, (H, W, 3), as its camera describes it (undistorted, full resolution).
    settings
        What is known of the room.

    Returns
    -------
    similarity
        (4, 4) float64 metres_from_reconstruction.
    report
        What was used, and residuals.

    Raises
    ------
    FiptError
        If something that the settings name is not found or contradicts itself.
    """
    cameras = {camera.name: camera for camera in reconstruction.cameras}
    warnings: list[str] = []
    _check_points(settings, cameras)
    placed: list[Placed] = []
    if settings.board is not None:
        targets = find_boards(reconstruction.cameras, read_image, settings.board)
        placed = [p for p in (place(target, cameras) for target in targets) if p is not None]
        if not placed:
            shown = ", ".join(sorted({view for target in targets for view in target.seen}))
            raise FiptError(
                f"the board must be seen from two places; it was found in {shown} only",
                "take another picture of it from the side",
            )
        wrong = sorted({view for p in placed for view in p.rejected})
        if wrong:
            warnings.append(f"the board contradicts the cameras of {', '.join(wrong)}")

    own_up, spread = cameras_up(reconstruction.cameras)
    if spread > 10:
        warnings.append(f"the cameras' own up directions differ by {spread:.0f} degrees: floor and walls may be wrong")
    floor = find_floor(reconstruction.points, reconstruction.centers, own_up, settings.seed)
    ups = {"board": _board_up(placed, settings, reconstruction.centers, own_up),
           "floor": None if floor is None else floor.normal, "cameras": own_up}  # fmt: skip
    source, up = _chosen("up", settings.up, ups)
    off = {name: _degrees(up, other) for name, other in ups.items() if other is not None and name != source}
    warnings += [f"up by {source} and by {name} differ by {angle:.1f} degrees"
                 for name, angle in off.items() if angle > (3 if name != "cameras" else 10)]  # fmt: skip
    if floor is not None and _degrees(up, floor.normal) > 5:
        floor = None  # a slope, or some table's edge: its height says nothing

    ground, floor_report = _ground(floor, placed, settings, reconstruction, up)
    metres, scale = _scale(settings, placed, reconstruction, cameras, ground, up, warnings)
    if floor is not None:
        floor_report["deviation"] = floor.deviation * metres

    rotation, walls = _turn(reconstruction, read_image, settings, up, placed, warnings)
    similarity = np.eye(4)
    similarity[:3, :3] = metres * rotation
    middle = rotation @ reconstruction.centers.mean(axis=0)
    similarity[:3, 3] = -metres * np.array([middle[0], ground, middle[2]])
    report = AlignReport(
        scale | {"metres_per_unit": metres},
        {"source": source, "off_degrees": off},
        walls,
        floor_report,
        tuple(warnings),
    )
    return similarity, report


# ------------------------------------------------------------------------------------------------------------ up


def cameras_up(cameras: Sequence[Camera]) -> tuple[np.ndarray, float]:
    """Up as photographers hold their cameras: nearly level, so that no camera's x axis points up or down.

    Returns
    -------
    up
        (3,) unit vector.
    spread
        Median angle between the cameras' x axes and the level plane, degrees.
    """
    axes = np.array([camera.world_from_camera[:3, :3] for camera in cameras])
    mean, x = axes[:, :, 1].mean(axis=0), axes[:, :, 0]
    up = mean / max(np.linalg.norm(mean), 1e-12)
    # What is across two cameras' x axes is across those of most, if those two are not the odd ones.
    pairs = np.array(list(combinations(range(len(x)), 2))[:: max(len(x) ** 2 // 4000, 1)], int).reshape(-1, 2)
    across = np.cross(x[pairs[:, 0]], x[pairs[:, 1]])
    length = np.linalg.norm(across, axis=1)
    across = across[length > 0.2] / length[length > 0.2, None]
    if len(across):
        best = across[np.argmin(np.median(np.abs(across @ x.T), axis=1))]
        level = x[np.abs(x @ best) < 0.2]
        values, vectors = np.linalg.eigh(level.T @ level / len(level))
        # Where cameras look one way, their x axes are one line, and any direction across it would do.
        if values[1] > 0.02:
            up = vectors[:, 0] * np.sign(vectors[:, 0] @ mean)
    return up, float(np.median(np.degrees(np.arcsin(np.clip(np.abs(x @ up), 0, 1)))))


def find_floor(points: np.ndarray, centers: np.ndarray, up: np.ndarray, seed: int) -> Plane | None:
    """Find the floor by random triples of (P, 3) points below all cameras; None if no plane holds enough of them.

    The floor is the lowest level plane with enough points, and little lies below it: a table may hold more points.
    """
    height, lowest = points @ up, (centers @ up).min()
    if len(points) < 20:
        return None
    extent = np.linalg.norm(np.ptp(np.percentile(points, [2, 98], axis=0), axis=0))
    low = points[height < lowest]
    if len(low) < 20:
        return None
    tolerance = _FLAT * extent
    rng = np.random.default_rng(seed)
    triples = low[rng.integers(len(low), size=(_FLOOR_TRIES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    # Thin triples have no certain normal.
    wide = length > (0.05 * extent) ** 2
    normals, corner = normals[wide] / length[wide, None], triples[wide, 0]
    normals *= np.sign(normals @ up)[:, None]
    level = normals @ up > np.cos(np.radians(_STEEPEST))
    normals, offsets = normals[level], (normals[level] * corner[level]).sum(axis=1)
    sample = low[rng.permutation(len(low))[:_FLOOR_SAMPLE]]
    away = (sample @ normal - offset for normal, offset in zip(normals, offsets, strict=True))
    counts = [((np.abs(each) < tolerance).sum(), (each < -2 * tolerance).sum()) for each in away]
    on, below = np.array(counts, float).reshape(-1, 2).T
    slices = max(int(np.ptp(sample @ up) / (2 * tolerance)), 1)
    by_chance = np.median(np.histogram(sample @ up, slices)[0])
    good = (on >= max(15, _MORE * by_chance, 0.1 * on.max(initial=0))) & (below < 0.5 * on)
    if not good.any():
        return None
    # Of planes at one height, within the tolerance, the one with the most points.
    middle = centers.mean(axis=0)
    drop = (normals @ middle - offsets) / (normals @ up)
    best = np.flatnonzero(good & (drop > drop[good].max() - 3 * tolerance))
    best = best[np.argmax(on[best] - below[best])]
    normal, offset = normals[best], offsets[best]
    for reach in (tolerance, 0.6 * tolerance, 0.6 * tolerance):
        near = low[np.abs(low @ normal - offset) < reach]
        if len(near) < 10:
            return None
        _, _, axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)
        normal = axes[2] * np.sign(axes[2] @ up)
        offset = float(normal @ near.mean(axis=0))
    return Plane(normal, offset, len(near), float(np.sqrt(np.mean((near @ normal - offset) ** 2))))


def _board_up(placed: Sequence[Placed], settings: Align, centers: np.ndarray, own_up: np.ndarray) -> np.ndarray | None:
    """Up by boards on the floor or on a wall: the mean over boards, weighted by the corners that show it."""
    if not placed or settings.board.place == "anywhere":
        return None
    found = []
    for board in placed:
        if settings.board.place == "floor":
            normal = board.rotation[:, 2]
            found.append(normal * np.sign((centers.mean(axis=0) - board.shift) @ normal))
        else:
            sides = np.concatenate([board.rotation[:, :2].T, -board.rotation[:, :2].T])
            found.append(sides[np.argmax(sides @ own_up)])
    mean = np.sum([up / max(board.pixels, 0.05) for up, board in zip(found, placed, strict=True)], axis=0)
    return mean / np.linalg.norm(mean)


def _degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _chosen(what: str, wanted: str, found: dict[str, Any]) -> tuple[str, Any]:
    """Return the name and value that a setting wants, or for ``auto`` the first there is."""
    for name, value in found.items():
        if wanted in (name, "auto") and value is not None:
            return name, value
    raise FiptError(
        f"poses.align.{what} is {wanted}, but that is not there",
        "found: " + (", ".join(name for name, value in found.items() if value is not None) or "nothing"),
    )


# --------------------------------------------------------------------------------------------------------- metres


def _ground(
    floor: Plane | None, placed: Sequence[Placed], settings: Align, reconstruction: Reconstruction, up: np.ndarray
) -> tuple[float, dict[str, Any]]:
    """Height of the floor along ``up`` under the middle of the cameras, in units of the reconstruction."""
    if floor is not None:
        middle = reconstruction.centers.mean(axis=0)
        # Straight down from the middle of the cameras to the plane.
        drop = (floor.normal @ middle - floor.offset) / (floor.normal @ up)
        return float(middle @ up - drop), {"source": "plane", "points": floor.points}
    if placed and settings.board.place == "floor":
        return float(np.median(np.concatenate([board.corners for board in placed]) @ up)), {"source": "board"}
    if len(reconstruction.points):
        return float(np.percentile(reconstruction.points @ up, 1)), {"source": "lowest points"}
    return float((reconstruction.centers @ up).min()), {"source": "lowest camera"}


def _scale(
    settings: Align, placed: Sequence[Placed], reconstruction: Reconstruction, cameras: dict[str, Camera],
    ground: float, up: np.ndarray, warnings: list[str],
) -> tuple[float, dict[str, Any]]:  # fmt: skip
    """Metres in a unit of the reconstruction, and where they come from."""
    heights = reconstruction.centers @ up - ground
    by_board, boards = _by_boards(placed, warnings)
    by_distance, distances = _by_distances(settings, cameras)
    by_tripod = None
    if settings.tripod_height is not None:
        middle = float(np.median(heights))
        if middle <= 0:
            raise FiptError("the cameras are not above the floor that was found", "give a board or measured distances")
        by_tripod = (settings.tripod_height / middle, float(np.std(heights) / middle / np.sqrt(len(heights))))
        if np.ptp(heights) > 0.1 * middle:
            warnings.append(
                f"tripod_height holds for all views, but their heights range from {heights.min() / middle:.2f} to "
                f"{heights.max() / middle:.2f} of the median"
            )
    found = {"board": by_board, "distances": by_distance, "tripod": by_tripod}
    if all(value is None for value in found.values()):
        if settings.scale != "auto":
            raise FiptError(
                f"poses.align.scale is {settings.scale}, but that is not given", "give it, or leave scale out"
            )
        metres = _ASSUMED_HEIGHT / max(float(np.median(heights)), 1e-9)
        warnings.append(
            f"nothing gives the scale: the median camera is assumed {_ASSUMED_HEIGHT} m above the floor; give "
            "poses.align.board, distances or tripod_height"
        )
        return metres, {"source": "assumed", "deviation": None}
    source, (metres, deviation) = _chosen("scale", settings.scale, found)
    off = {name: other[0] / metres - 1 for name, other in found.items() if other is not None and name != source}
    warnings += [f"scale by {source} and by {name} differ by {share:+.1%}"
                 for name, share in off.items() if abs(share) > 0.02]  # fmt: skip
    if deviation is not None and deviation > 0.01:
        warnings.append(f"the scale by {source} is uncertain by {deviation:.1%}")
    for item in distances:
        item["found_metres"] = item.pop("units") * metres
        item["off_millimetres"] = (item["found_metres"] - item["metres"]) * 1000
    return metres, {"source": source, "deviation": deviation, "off": off, "boards": boards, "distances": distances}


def _by_boards(placed: Sequence[Placed], warnings: list[str]) -> tuple[tuple[float, float] | None, list[dict]]:
    """Scale by boards and tags: their mean, weighted by how well each is known."""
    if not placed:
        return None, []
    each = np.array([1 / board.scale for board in placed])
    deviations = np.array([max(board.deviation, 1e-5) for board in placed])
    middle = float(np.median(each))
    weights = np.where(np.abs(each / middle - 1) < 0.05, deviations**-2, 0.0)
    if not weights.any():
        weights = deviations**-2
    metres = float(np.average(each, weights=weights))
    odd = [board.name for board, weight in zip(placed, weights, strict=True) if weight == 0]
    if odd:
        warnings.append(f"{', '.join(odd)} have another size than the other tags, and are not used")
    deviation = float(weights.sum() ** -0.5) if len(placed) == 1 else _deviation(each, weights, metres)
    listed = [
        {
            "name": board.name, "views": list(board.views), "rejected": list(board.rejected),
            "metres_per_unit": 1 / board.scale, "pixels": board.pixels, "millimetres": board.millimetres,
        }
        for board in placed
    ]  # fmt: skip
    return (metres, deviation), listed


def _deviation(each: np.ndarray, weights: np.ndarray, mean: float) -> float:
    """Relative standard deviation of a weighted mean: what the weights say, or the spread if that is more."""
    said = float(weights.sum() ** -0.5)
    effective = weights.sum() ** 2 / (weights**2).sum()
    seen = float(np.sqrt(np.average((each / mean - 1) ** 2, weights=weights) / max(effective - 1, 1)))
    return max(said, seen)


def _check_points(settings: Align, cameras: dict[str, Camera]) -> None:
    """Refuse named points and distances that cannot be what was meant."""
    for name, pixels in settings.points.items():
        where = f"poses.align.points.{name}"
        for view, (column, row) in pixels.items():
            if view not in cameras:
                known = ", ".join(list(cameras)[:8])
                raise FiptError(f"{where} names view {view}, which has no camera", f"views with one: {known}")
            camera = cameras[view]
            if not (0 <= column <= camera.width and 0 <= row <= camera.height):
                raise FiptError(
                    f"{where}: pixel {column:g}, {row:g} of view {view} is outside its {camera.width}x{camera.height} "
                    "pixels",
                    "give column and row in the undistorted picture",
                )
        if len(pixels) < 2:
            raise FiptError(
                f"{where} must be seen in two or more views; it is in {', '.join(pixels) or 'none'}",
                "add its pixel in another view",
            )
    for index, distance in enumerate(settings.distances):
        where = f"poses.align.distances.{index}"
        for name in distance.between:
            if name not in settings.points:
                raise FiptError(
                    f"{where} names point {name}, which is not in poses.align.points",
                    f"points: {', '.join(settings.points) or 'none'}",
                )
        if distance.between[0] == distance.between[1]:
            raise FiptError(f"{where} must be between two points; both are {distance.between[0]}", "name two")


def _by_distances(settings: Align, cameras: dict[str, Camera]) -> tuple[tuple[float, float | None] | None, list[dict]]:
    """Scale by measured distances: their least squares, and every distance with its points' residuals."""
    if not settings.distances:
        return None, []
    points = {}
    for name in dict.fromkeys(name for distance in settings.distances for name in distance.between):
        pixels = settings.points[name]
        found = triangulate([cameras[view] for view in pixels], np.array(list(pixels.values())))
        if found.parallax < _PARALLAX:
            raise FiptError(
                f"poses.align.points.{name} must be seen from different places; its rays in {', '.join(pixels)} differ "
                f"by {found.parallax:.2f} degrees",
                "add its pixel in a view from the side",
            )
        if found.residual.max() > _APART:
            view = list(pixels)[int(np.argmax(found.residual))]
            raise FiptError(
                f"the pixels of poses.align.points.{name} must show one point; that of view {view} is "
                f"{found.residual.max():.0f} pixels from where the others put it",
                "check the pixels, which are column and row in the undistorted pictures",
            )
        points[name] = found
    listed = []
    for distance in settings.distances:
        a, b = (points[name] for name in distance.between)
        units = float(np.linalg.norm(a.position - b.position))
        if units <= 0:
            raise FiptError(
                f"points {' and '.join(distance.between)} are {distance.metres:g} m apart, but show one place",
                "check their pixels",
            )
        worst = float(max(a.residual.max(), b.residual.max()))
        listed.append({"between": list(distance.between), "metres": distance.metres, "units": units, "pixels": worst})
    measured = np.array([item["metres"] for item in listed])
    units = np.array([item["units"] for item in listed])
    metres = float(measured @ units / (units @ units))
    spread = float(np.std(measured / (metres * units)) / np.sqrt(len(units) - 1)) if len(units) > 1 else None
    return (metres, spread), listed


# ---------------------------------------------------------------------------------------------------------- walls


def _turn(
    reconstruction: Reconstruction, read_image: ReadImage, settings: Align, up: np.ndarray,
    placed: Sequence[Placed], warnings: list[str],
) -> tuple[np.ndarray, dict[str, Any] | None]:  # fmt: skip
    """Rotation into axes with y up and the walls along x and z, and what is known of the walls."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first /= np.linalg.norm(first)
    level = np.stack([first, np.cross(first, up)])  # x and z of a right-handed frame whose y is up
    walls = None
    if settings.walls:
        with progress("walls", len(reconstruction.cameras), " views") as bar:
            walls = find_walls(
                reconstruction.cameras, read_image, reconstruction.points, up, level,
                [board.corners for board in placed], lambda view: bar.advance(1, view),
            )  # fmt: skip
    angle = np.radians(walls.angle if walls else 0.0)
    x = np.cos(angle) * level[0] + np.sin(angle) * level[1]
    z = np.cross(x, up)
    shown = reconstruction.points if len(reconstruction.points) >= 20 else reconstruction.centers
    sides = np.ptp(np.percentile(shown @ np.stack([x, z]).T, [2, 98], axis=0), axis=0)
    if walls is not None and sides[1] > sides[0]:
        x, z = -z, x
    if reconstruction.cameras[0].world_from_camera[:3, 2] @ z < 0:
        x, z = -x, -z
    report = None
    if walls is not None:
        statement = "the longer side lies along x; the first camera looks towards -z"
        if sides.max() < 1.1 * sides.min():
            statement += "; the sides are nearly equal, so that a new reconstruction may come out turned by 90 degrees"
        if walls.ambiguous:
            statement += f"; another direction has {walls.rival:.0%} of the votes"
            warnings.append(f"the walls' direction is ambiguous: another one has {walls.rival:.0%} of its votes")
        report = asdict(walls) | {"ambiguous": walls.ambiguous, "statement": statement}
    elif settings.walls:
        warnings.append("nothing tells how the walls stand: the room is upright, but turned by chance")
    return np.stack([x, up, z]), report
