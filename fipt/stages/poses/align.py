"""A reconstruction in metres, upright, with its walls along the axes and its floor at y = 0.

Cameras from images have no scale and stand anyhow. Metres come from a board in the room, from measured distances
between named points, or from the tripod's height over the floor; up from the board, the floor, or the cameras. All that
is known is compared; what was used, and how well the rest agrees, is in the `AlignReport`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.stages.poses.manhattan import find_walls
from fipt.stages.poses.metres import check_points, chosen, metres_per_unit
from fipt.stages.poses.model import Reconstruction
from fipt.stages.poses.room_boards import PlacedTarget, ReadImage, find_boards, place
from fipt.stages.poses.settings import Align, SceneBoard
from fipt.stages.poses.upright import board_up, cameras_up, degrees_between, find_floor, ground_height

_ASKEW = 3.0
"""Degrees between a board and the floor from which floor and cameras, where they agree, overrule the board.

A board that lies flat tells up to 0.3 degrees.
"""


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


def align(
    reconstruction: Reconstruction,
    read_image: ReadImage,
    settings: Align,
    orientation: Mapping[str, int] | None = None,
) -> tuple[np.ndarray, AlignReport]:
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
    orientation
        View -> EXIF orientation; of others it is 1, the sensor's own.

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
    check_points(settings, cameras)
    placed = _placed(reconstruction, read_image, settings.board, warnings)
    own_up, spread = cameras_up(reconstruction.cameras, orientation or {})
    if spread > 10:
        warnings.append(f"the cameras' own up directions differ by {spread:.0f} degrees: floor and walls may be wrong")
    floor = find_floor(reconstruction.points, reconstruction.centers, own_up, settings.seed)
    ups = {
        "board": board_up(placed, settings.board, reconstruction.centers, own_up),
        "floor": None if floor is None else floor.normal,
        "cameras": own_up,
    }
    source, up, off = _up(ups, settings.up, warnings)
    if floor is not None and degrees_between(up, floor.normal) > 5:
        floor = None  # a slope, or some table's edge: its height says nothing

    ground, floor_report = ground_height(floor, placed, settings.board, reconstruction, up)
    metres, scale = metres_per_unit(settings, placed, reconstruction, cameras, ground, up, warnings)
    if floor is not None:
        floor_report["deviation"] = floor.deviation * metres

    rotation, walls = _turn(reconstruction, read_image, settings, up, placed, warnings)
    similarity = _similarity(rotation, metres, rotation @ reconstruction.centers.mean(axis=0), ground)
    scale |= {"metres_per_unit": metres}
    return similarity, AlignReport(scale, {"source": source, "off_degrees": off}, walls, floor_report, tuple(warnings))


def _similarity(rotation: np.ndarray, metres: float, middle: np.ndarray, ground: float) -> np.ndarray:
    """(4, 4) that turns, scales, and brings the point below ``middle`` (3,), which is turned already, to the origin."""
    similarity = np.eye(4)
    similarity[:3, :3] = metres * rotation
    similarity[:3, 3] = -metres * np.array([middle[0], ground, middle[2]])
    return similarity


def _placed(
    reconstruction: Reconstruction, read_image: ReadImage, board: SceneBoard | None, warnings: list[str]
) -> list[PlacedTarget]:
    """Find the boards and tags of a room in its views and place them; none where the settings name none."""
    if board is None:
        return []
    cameras = {camera.name: camera for camera in reconstruction.cameras}
    targets = find_boards(reconstruction.cameras, read_image, board)
    placed = [p for p in (place(target, cameras) for target in targets) if p is not None]
    if not placed:
        shown = ", ".join(sorted({view for target in targets for view in target.seen}))
        raise FiptError(
            f"the board must be seen from two places; it was found in {shown} only",
            "take another photograph of it from the side",
        )
    wrong = sorted({view for p in placed for view in p.rejected})
    if wrong:
        warnings.append(f"the board contradicts the cameras of {', '.join(wrong)}")
    return placed


def _up(
    ups: Mapping[str, np.ndarray | None], wanted: str, warnings: list[str]
) -> tuple[str, np.ndarray, dict[str, float]]:
    """Source and direction of up, and by how many degrees the other estimates differ from it."""
    source, up = chosen("up", wanted, ups)
    board, floor, own = ups["board"], ups["floor"], ups["cameras"]
    if wanted == "auto" and source == "board" and board is not None and floor is not None and own is not None:
        askew, between = degrees_between(board, floor), degrees_between(floor, own)
        if askew > _ASKEW and between < askew / 3:
            source, up = "floor", floor
            warnings.append(
                f"the board is askew by {askew:.1f} degrees: floor and cameras, which agree to {between:.1f}, tell up; "
                "poses.align.up: board overrules them"
            )
            return source, up, {"board": askew, "cameras": between}
    off = {name: degrees_between(up, other) for name, other in ups.items() if other is not None and name != source}
    warnings += [
        f"up by {source} and by {name} differ by {angle:.1f} degrees"
        for name, angle in off.items()
        if angle > (3 if name != "cameras" else 10)
    ]
    return source, up, off


def _turn(
    reconstruction: Reconstruction, read_image: ReadImage, settings: Align, up: np.ndarray,
    placed: Sequence[PlacedTarget], warnings: list[str],
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
