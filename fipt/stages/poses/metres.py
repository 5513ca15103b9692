"""How many metres a unit of a reconstruction has: by boards, by measured distances, by the tripod."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.scene.cameras import Camera
from fipt.stages.poses.model import Reconstruction
from fipt.stages.poses.room_boards import PlacedTarget
from fipt.stages.poses.settings import Align
from fipt.stages.poses.triangulate import triangulate

Listed = list[dict[str, Any]]
"""Boards or distances for poses.json, plain values."""

_ASSUMED_HEIGHT = 1.5
"""Height of the cameras above the floor in metres that is assumed where nothing gives a scale."""

_PARALLAX = 1.0
"""Degrees between the rays of a named point, at least."""

_MISSED = 8.0
"""Pixels by which the rays of a named point may miss each other."""


def chosen(what: str, wanted: str, found: Mapping[str, Any]) -> tuple[str, Any]:
    """Return the name and value that a setting wants, or for ``auto`` the first there is."""
    for name, value in found.items():
        if wanted in (name, "auto") and value is not None:
            return name, value
    raise FiptError(
        f"poses.align.{what} is {wanted}, but that is not there",
        "found: " + (", ".join(name for name, value in found.items() if value is not None) or "nothing"),
    )


def metres_per_unit(
    settings: Align, placed: Sequence[PlacedTarget], reconstruction: Reconstruction, cameras: dict[str, Camera],
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
    source, (metres, deviation) = chosen("scale", settings.scale, found)
    off = {name: other[0] / metres - 1 for name, other in found.items() if other is not None and name != source}
    warnings += [f"scale by {source} and by {name} differ by {share:+.1%}"
                 for name, share in off.items() if abs(share) > 0.02]  # fmt: skip
    if deviation is not None and deviation > 0.01:
        warnings.append(f"the scale by {source} is uncertain by {deviation:.1%}")
    for item in distances:
        item["found_metres"] = item.pop("units") * metres
        item["off_millimetres"] = (item["found_metres"] - item["metres"]) * 1000
    return metres, {"source": source, "deviation": deviation, "off": off, "boards": boards, "distances": distances}


def _by_boards(placed: Sequence[PlacedTarget], warnings: list[str]) -> tuple[tuple[float, float] | None, Listed]:
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


def check_points(settings: Align, cameras: dict[str, Camera]) -> None:
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
                    "give column and row in the undistorted image",
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


def _by_distances(settings: Align, cameras: dict[str, Camera]) -> tuple[tuple[float, float | None] | None, Listed]:
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
        if found.residual.max() > _MISSED:
            view = list(pixels)[int(np.argmax(found.residual))]
            raise FiptError(
                f"the pixels of poses.align.points.{name} must show one point; that of view {view} is "
                f"{found.residual.max():.0f} pixels from where the others put it",
                "check the pixels, which are column and row in the undistorted images",
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
