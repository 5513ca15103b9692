"""A ChArUco board that stands in a simulated room, so that reconstructed cameras can find metres and up."""

from typing import Any

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.settings import SimulatedBoard
from fipt.synthesize.furniture import SIZE, Part
from fipt.synthesize.shapes import panel

_TEXELS = 32
"""Along a square."""

_GAP = 0.004
"""Distance from floor or wall, metres."""

_BLACK, _WHITE = 0.04, 0.8
"""Base colours of the print."""


def board_part(board: SimulatedBoard) -> Part:
    """Return the board as a textured panel with a white margin of half a square."""
    picture = np.float32(_charuco(board).generateImage(_size(board), marginSize=_TEXELS // 2))
    color = np.repeat((_BLACK + (_WHITE - _BLACK) / 255 * picture)[..., None], 3, axis=2)
    corner, u, v = _frame(board)
    # Textures have their outermost texel centres on the panel's edges: the panel ends half a texel inside the print.
    texel = board.square / _TEXELS
    height, width = picture.shape
    start = corner + (0.5 * texel - 0.5 * board.square) * (u + v)
    shape = panel(start, u * (width - 1) * texel, v * (height - 1) * texel)
    return Part("board", "picture", shape, color, 0.9)


def described(board: SimulatedBoard) -> dict[str, Any]:
    """Return what room.json says of the board: its make, and the places of its inner corners, row by row, metres."""
    corner, u, v = _frame(board)
    flat = np.array(_charuco(board).getChessboardCorners(), float)
    corners = corner + flat[:, :1] * u + flat[:, 1:2] * v
    make = board.model_dump(include={"columns", "rows", "square", "marker", "dictionary", "place"})
    return make | {"corners": np.round(corners, 6).tolist()}


def _charuco(board: SimulatedBoard) -> cv2.aruco.CharucoBoard:
    from fipt.io.boards import charuco_board, dictionary

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


def _frame(board: SimulatedBoard) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Top left corner of the first square and unit vectors along a row and down a column, as one looks at the board."""
    turn = np.radians(board.turn)
    center = np.array(board.position, float)
    size = np.array(SIZE)
    if board.place == "floor":
        normal, right = np.array([0.0, 1, 0]), np.array([1.0, 0, 0])
        center[1] += _GAP
    else:
        axis = min((0, 2), key=lambda k: min(center[k], size[k] - center[k]))
        normal = np.zeros(3)
        normal[axis] = 1.0 if center[axis] < size[axis] / 2 else -1.0
        center[axis] = _GAP if normal[axis] > 0 else size[axis] - _GAP
        right = np.cross((0, 1, 0), normal)
    down = np.cross(right, normal)
    u = np.cos(turn) * right + np.sin(turn) * down
    v = np.cross(u, normal)
    half = 0.5 * board.square * ((board.columns + 1) * np.abs(u) + (board.rows + 1) * np.abs(v))
    if ((center - half < -1e-9) | (center + half > size + 1e-9)).any():
        raise FiptError(
            f"synthesize.board.position must put the board inside the room of {SIZE[0]} x {SIZE[1]} x {SIZE[2]} m; it "
            f"reaches from {np.round(center - half, 2).tolist()} to {np.round(center + half, 2).tolist()}",
            "move it, or give it fewer squares",
        )
    return center - 0.5 * board.square * ((board.columns + 1) * u + (board.rows + 1) * v), u, v
