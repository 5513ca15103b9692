"""Boards with markers in images: ChArUco boards and AprilTags, by OpenCV, in this program's pixels.

Corners come as image coordinates with the centre of the top left pixel at (0.5, 0.5); OpenCV has it at (0, 0).
"""

import cv2
import numpy as np

from fipt.errors import FiptError

_MATCH = 0.8
"""Correlation of a board's pattern with the image from which on the two are believed to be the same."""
_MOVED = 0.1
"""How far corners may move when the whole pattern is matched, in squares."""
_TEXELS = 224
"""Along a square of the pattern as it is drawn; OpenCV draws a marker's fields in whole texels."""


def dictionary(name: str, key: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's dictionary of markers by its name; ``key`` is the setting that names it, for the error."""
    number = getattr(cv2.aruco, name, None)
    if not isinstance(number, int) or not name.startswith("DICT_"):
        raise FiptError(f"{key} must be one of OpenCV's; found {name!r}", "for example DICT_5X5_100")
    return cv2.aruco.getPredefinedDictionary(number)


def charuco_board(
    inner: tuple[int, int], square: float, marker: float, markers: cv2.aruco.Dictionary
) -> cv2.aruco.CharucoBoard:
    """Return a board with ``inner`` (columns, rows) corners; lengths in metres."""
    return cv2.aruco.CharucoBoard((inner[0] + 1, inner[1] + 1), square, marker, markers)


def charuco_corners(
    grey: np.ndarray, board: cv2.aruco.CharucoBoard, least: int, beside: int = 2
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Find a ChArUco board.

    Parameters
    ----------
    grey
        (H, W) uint8 image.
    board
        What to look for.
    least
        Fewer corners than this count as none.
    beside
        Markers beside a corner that must be read, 1 or 2.

    Returns
    -------
    points
        (N, 3) float32 places on the board, metres: x along its columns, y along its rows, z = 0.
    pixels
        (N, 2) float32 image coordinates.
    ids
        (N,) int32 numbers of the corners, row by row.
    """
    parameters = cv2.aruco.CharucoParameters()
    parameters.minMarkers = beside
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board, parameters).detectBoard(grey)
    if ids is None or len(ids) < least:
        return None
    objects, images = board.matchImagePoints(corners, ids)  # pyright: ignore[reportCallIssue, reportArgumentType] - stubs want a list
    # Windows end before the markers.
    clear = 0.4 * (board.getSquareLength() - board.getMarkerLength()) / board.getSquareLength()
    return objects.reshape(-1, 3), refined(grey, images.reshape(-1, 2), clear) + np.float32(0.5), ids.reshape(-1)


def board_corners(
    grey: np.ndarray, board: cv2.aruco.CharucoBoard, pixels: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Find every corner of a flat board by matching its whole pattern; a small board is so known ten times better.

    Windows around corners of a board that is far away are a few pixels wide and hold its markers too. The homography
    that makes the board's own image match (Evangelidis and Psarakis 2008) hangs on all of its edges.

    Parameters
    ----------
    grey
        (H, W) uint8 image without lens distortion, proportional to the light.
    board
        What is there.
    pixels, ids
        (N, 2) image coordinates and (N,) numbers of four or more corners that were found.

    Returns
    -------
    pixels
        (M, 2) float64 image coordinates of the corners inside the image.
    ids
        (M,) int32 their numbers.
    match
        Correlation of pattern and image.

    None if the image does not show the board's pattern there.
    """
    places = np.array(board.getChessboardCorners())[:, :2].astype(np.float64) / board.getSquareLength()
    rough, _ = cv2.findHomography(places[ids], pixels, 0)
    if rough is None:
        return None
    every = cv2.perspectiveTransform(places[:, None], rough)[:, 0]
    gaps = np.linalg.norm(every[:, None] - every, axis=2)
    np.fill_diagonal(gaps, np.inf)
    square = float(np.median(gaps.min(axis=1)))
    side = int(np.clip(round(square), 8, 64))  # one texel of the pattern along one pixel
    pattern, rim = _pattern(board, side)
    # from texels to pixels; both have their first centre at 0 for OpenCV
    warp = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]]) @ rough
    first = (rim + 0.5) / side
    warp = warp @ np.array([[1 / side, 0, first], [0, 1 / side, first], [0, 0, 1]])
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-7)
    everywhere = np.full(grey.shape, 255, np.uint8)
    try:
        match, warp = cv2.findTransformECC(
            pattern, grey, (warp / warp[2, 2]).astype(np.float32), cv2.MOTION_HOMOGRAPHY, stop, everywhere, 3
        )
    except cv2.error:  # it does not converge where something else is there
        return None
    texels = places * side - rim - 0.5
    found = cv2.perspectiveTransform(texels[:, None], warp.astype(np.float64))[:, 0] + 0.5
    moved = np.linalg.norm(found[ids] - pixels, axis=1)
    if match < _MATCH or np.median(moved) > max(_MOVED * square, 1.0):
        return None
    height, width = grey.shape
    inside = ((found > 0) & (found < (width, height))).all(axis=1)
    return found[inside], np.flatnonzero(inside).astype(np.int32), match


def _pattern(board: cv2.aruco.CharucoBoard, side: int) -> tuple[np.ndarray, int]:
    """(H, W) uint8 drawing of a board with ``side`` texels a square, and the texels cut off around it."""
    columns, rows = board.getChessboardSize()
    pattern = board.generateImage((_TEXELS * columns, _TEXELS * rows), marginSize=0, borderBits=1)
    pattern = cv2.resize(pattern, (side * columns, side * rows), interpolation=cv2.INTER_AREA)
    # what ends at an edge would be pulled inwards by the image's blur
    rim = side // 3
    return pattern[rim:-rim, rim:-rim], rim


def tag_corners(grey: np.ndarray, markers: cv2.aruco.Dictionary) -> dict[int, np.ndarray]:
    """Find single markers: id -> (4, 2) float64 image coordinates of its corners, clockwise from its top left one.

    ``grey`` is (H, W) uint8 and proportional to the light: a tone curve would move the edges between black and white.
    """
    found, ids, _ = cv2.aruco.ArucoDetector(markers).detectMarkers(grey)
    if ids is None:
        return {}
    return {int(i): _sides_meet(grey, c.reshape(4, 2)) + 0.5 for i, c in zip(ids.reshape(-1), found, strict=True)}


def _sides_meet(grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Corners of a dark square to a few hundredths of a pixel: where lines through the edges of its sides meet.

    Each side is met at several places by a short line across it, on which the edge is the mean of the slope's places.
    """
    from scipy.ndimage import map_coordinates

    corners = corners.astype(np.float64)
    lines = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = np.linalg.norm(b - a)
        across = np.array([b[1] - a[1], a[0] - b[0]]) / side
        reach = np.clip(0.09 * side, 1.5, 5.0)  # the black border is an eighth of the side
        steps = np.arange(-reach, reach + 1e-9, 0.25)
        middle = a + np.linspace(0.15, 0.85, 24)[:, None] * (b - a)
        place = middle[:, None] + steps[None, :, None] * across
        light = map_coordinates(grey.astype(np.float64), [place[..., 1], place[..., 0]], order=1, mode="nearest")
        slope = np.maximum(np.diff(light, axis=1), 0)  # from black to white only
        total = slope.sum(axis=1)
        if (total <= 0).all():
            return corners
        edge = middle + ((slope @ (steps[1:] - 0.125)) / np.maximum(total, 1e-9))[:, None] * across
        edge = edge[total > 0.5 * np.median(total)]
        center = edge.mean(axis=0)
        normal = np.linalg.svd(edge - center)[2][1]
        lines.append((normal, normal @ center))
    meet = [
        np.linalg.solve(np.stack([before[0], after[0]]), [before[1], after[1]])
        for before, after in zip(lines[-1:] + lines[:-1], lines, strict=True)
    ]
    return np.array(meet)


def tag_points(side: float) -> np.ndarray:
    """(4, 3) float32 corners of a marker of this side, metres, in the order of `tag_corners`; y goes down as a row."""
    return np.array([[0, 0, 0], [side, 0, 0], [side, side, 0], [0, side, 0]], np.float32)


def refined(grey: np.ndarray, corners: np.ndarray, reach: float) -> np.ndarray:
    """Corners to a few hundredths of a pixel: where the edges within ``reach`` squares around each of them meet.

    Parameters
    ----------
    grey
        (H, W) uint8 image.
    corners
        (N, 2) places in OpenCV's pixels, at least two; returned alike, float32.
    reach
        Half the window, in distances of neighbouring corners.
    """
    gaps = np.linalg.norm(corners[:, None] - corners, axis=2)
    np.fill_diagonal(gaps, np.inf)
    half = int(np.clip(reach * np.median(gaps.min(axis=1)), 2, 15))
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
    return cv2.cornerSubPix(grey, start.copy(), (half, half), (-1, -1), stop).reshape(-1, 2)
