"""A ChArUco board that stands in a simulated room, so that reconstructed cameras can find metres and up."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.scene.mesh import Mesh
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.room import SyntheticRoom
from fipt.synthetic.settings import SimulatedBoard
from fipt.synthetic.shapes import panel

_TEXELS = 32
"""Along a square."""

_GAP = 0.004
"""Distance from the place that is given, so that it may lie on floor or wall, metres."""

_BLACK, _WHITE = 0.04, 0.8
"""Base colours of the print."""

_ROUGHNESS = 0.9


def with_board(room: SyntheticRoom, board: SimulatedBoard) -> SyntheticRoom:
    """Return the room with the board as its last part and last triangles; its white margin is half a square wide."""
    image = np.asarray(_charuco(board).generateImage(_size(board), marginSize=_TEXELS // 2), np.float32)
    color = np.repeat((_BLACK + (_WHITE - _BLACK) / 255 * image)[..., None], 3, axis=2)
    dull, no_metal = np.full((1, 1), _ROUGHNESS, np.float32), np.zeros((1, 1), np.float32)
    corner, u, v = _frame(board, room.box)
    columns, rows = (board.square * (count + 2) for count in (board.columns, board.rows))
    print_ = panel(corner - 0.5 * board.square * (u + v), u * columns, v * rows)

    def more(known: np.ndarray, added: np.ndarray) -> np.ndarray:
        return np.concatenate([known, np.asarray(added, known.dtype)])

    def both(known: np.ndarray, value: int) -> np.ndarray:
        return more(known, np.full((len(print_.triangles), *known.shape[1:]), value))

    mesh = Mesh(
        more(room.mesh.vertices, print_.vertices),
        more(room.mesh.triangles, print_.triangles + len(room.mesh.vertices)),
    )
    return replace(
        room,
        parts=(*room.parts, "board"),
        semantics=(*room.semantics, "board"),
        materials=(*room.materials, RoomMaterial("board", color, dull, no_metal)),
        mesh=mesh,
        uv=more(room.uv, print_.uv),
        part=both(room.part, len(room.parts) + 1),
        semantic=both(room.semantic, len(room.semantics) + 1),
        material=both(room.material, len(room.materials)),
        radiance=both(room.radiance, 0),
        facts=room.facts | {"board": _described(board, room.box)},
    )


def _described(board: SimulatedBoard, box: np.ndarray) -> dict[str, Any]:
    """Return what room.json says of the board: its make, and the places of its inner corners, row by row, metres."""
    corner, u, v = _frame(board, box)
    flat = np.array(_charuco(board).getChessboardCorners(), float)
    corners = corner + flat[:, :1] * u + flat[:, 1:2] * v
    make = board.model_dump(include={"columns", "rows", "square", "marker", "dictionary", "place"})
    return make | {"corners": np.round(corners, 6).tolist()}


def _charuco(board: SimulatedBoard) -> cv2.aruco.CharucoBoard:
    from fipt.scene.boards import charuco_board, dictionary

    if board.marker >= board.square:
        raise FiptError(
            f"synthesize.board.marker must be smaller than square; found {board.marker:g} and {board.square:g}",
            "markers stand inside the white squares",
        )
    markers = dictionary(board.dictionary, "synthesize.board.dictionary")
    return charuco_board((board.columns, board.rows), board.square, board.marker, markers)


def _size(board: SimulatedBoard) -> tuple[int, int]:
    """Texels of the print with its margin: columns, rows."""
    return (board.columns + 2) * _TEXELS, (board.rows + 2) * _TEXELS


def _frame(board: SimulatedBoard, box: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Top left corner of the first square and unit vectors along a row and down a column, as one looks at the board."""
    low, high = box
    turn = np.radians(board.turn)
    center = np.array(board.position, float)
    if board.place == "floor":
        normal, right = np.array([0.0, 1, 0]), np.array([1.0, 0, 0])
    else:
        axis = min((0, 2), key=lambda k: min(center[k] - low[k], high[k] - center[k]))
        normal = np.zeros(3)
        normal[axis] = 1.0 if center[axis] < (low + high)[axis] / 2 else -1.0
        right = np.cross((0, 1, 0), normal)
    center += _GAP * normal
    down = np.cross(right, normal)
    u = np.cos(turn) * right + np.sin(turn) * down
    v = np.cross(u, normal)
    half = 0.5 * board.square * ((board.columns + 1) * np.abs(u) + (board.rows + 1) * np.abs(v))
    if ((center - half < low - 1e-9) | (center + half > high + 1e-9)).any():
        raise FiptError(
            f"synthesize.board.position must put the board inside the room, from {np.round(low, 2).tolist()} to "
            f"{np.round(high, 2).tolist()}; it reaches from "
            f"{np.round(center - half, 2).tolist()} to {np.round(center + half, 2).tolist()}",
            "move it, or give it fewer squares",
        )
    return center - 0.5 * board.square * ((board.columns + 1) * u + (board.rows + 1) * v), u, v
