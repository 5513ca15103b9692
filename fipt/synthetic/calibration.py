"""What the simulated camera sees when it is calibrated: boards, an even wall, darkness, a grey card."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from fipt.errors import FiptError
from fipt.scene.cameras import Camera
from fipt.synthetic.camera import Optics, Sensor
from fipt.synthetic.settings import SimulatedCamera

FILL = 0.6
"""Share of saturation that the brightest part of a calibration frame reaches on the optical axis."""

_BLACK, _WHITE, _AROUND = 0.05, 0.9, 0.25
"""Reflectance of the board's squares and border, and of what is behind it."""
_SUB = 4
"""Rays along each side of a source pixel."""
MARKER = 0.72
"""Side of a ChArUco marker over that of a square."""
DICTIONARY = "DICT_5X5_100"
"""Of the ChArUco markers, as OpenCV names it."""
_TEXELS = 56
"""Of a ChArUco square in the drawn board."""
_TRIES = 500


def boards(planes: Optics, camera: SimulatedCamera, kind: str) -> Iterator[np.ndarray]:
    """Yield views of a board, ``checkerboard`` or ``charuco``, in the poses of `board_pose`.

    Yields
    ------
    (h, w, 3) float32 source image; white is 0.9.
    """
    drawn = drawn_charuco(camera) if kind == "charuco" else None
    for index in range(camera.calibration_frames):
        pose = board_pose(planes.sensor, camera, index)
        yield grey(planes.source, lambda x, y, pose=pose: board(x, y, pose, camera, drawn))


def board_pose(sensor: Sensor, camera: SimulatedCamera, index: int) -> np.ndarray:
    """Draw a pose in which the sensor sees the whole board.

    It is camera_from_board, (3, 4) float64, OpenCV axes (x right, y down, z ahead), metres; the board's inner corners
    are at (column, row, 0) times the square.

    The boards stand in turn in each corner, at each side and in the middle of the frame, so that they cover it.
    """
    rng = np.random.default_rng([camera.seed, 5, index])
    columns, rows = camera.board
    # Half a square of the white border belongs to what must be seen: detectors look for it.
    corners = np.array([(x, y, 0) for x in (-1.5, columns + 0.5) for y in (-1.5, rows + 0.5)]) * camera.square
    corners -= corners.mean(axis=0)
    frame = np.array((sensor.width, sensor.height))
    focal = np.array((sensor.fx, sensor.fy))
    toward = np.array((index % 3 - 1, index // 3 % 3 - 1))
    for _ in range(_TRIES):
        turn = rotation(*np.radians(rng.uniform((-35, -35, -15), (35, 35, 15))))
        distance = (np.ptp(corners, axis=0)[:2] * focal / frame).max() / rng.uniform(0.5, 0.75)
        # From the middle, as far as there is room.
        size = np.ptp((corners @ turn.T)[:, :2], axis=0) * focal / distance
        shift = toward * np.maximum(frame - size, 0) / 2 * rng.uniform(0.6, 1.1)
        place = np.append((shift + frame / 2 - (sensor.cx, sensor.cy)) / focal, 1) * distance
        seen = corners @ turn.T + place
        if (seen[:, 2] <= 0).any():
            continue
        across, down = sensor.distort(*(seen[:, :2] / seen[:, 2:]).T)
        if (np.abs(np.stack([across, down], 1) - frame / 2) < frame / 2 - 1).all():
            middle = np.array([columns - 1, rows - 1, 0]) * camera.square / 2
            return np.column_stack([turn, place - turn @ middle])
    raise FiptError("no pose found in which the camera sees the whole checkerboard", "use weaker distortion")


def rotation(pitch: float, yaw: float, roll: float) -> np.ndarray:
    """(3, 3) rotation by angles around x, y and z, radians."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("zyx", (roll, yaw, pitch)).as_matrix()


def drawn_charuco(camera: SimulatedCamera) -> np.ndarray:
    """OpenCV's drawing of the ChArUco board: (rows + 1, columns + 1) squares of 56 x 56 uint8."""
    import cv2

    squares = (camera.board[0] + 1, camera.board[1] + 1)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    layout = cv2.aruco.CharucoBoard(squares, camera.square, MARKER * camera.square, dictionary)
    return layout.generateImage((squares[0] * _TEXELS, squares[1] * _TEXELS))


def board(
    x: np.ndarray, y: np.ndarray, pose: np.ndarray, camera: SimulatedCamera, drawn: np.ndarray | None = None
) -> np.ndarray:
    """Return the reflectance that rays (x, y, 1) meet: the checkerboard, or a board that is drawn otherwise."""
    # The plane's points map to the image by the homography of the pose; its inverse maps back.
    homography = np.linalg.inv(pose[:, [0, 1, 3]])
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in homography)
    columns, rows = camera.board
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = u / w / camera.square, v / w / camera.square
    ahead = w > 0
    squares = ahead & (u >= -1) & (u < columns) & (v >= -1) & (v < rows)
    paper = ahead & (u >= -2) & (u < columns + 1) & (v >= -2) & (v < rows + 1)
    if drawn is None:
        with np.errstate(invalid="ignore"):
            dark = (np.floor(u) + np.floor(v)) % 2 == 0
    else:
        row, column = ((np.where(squares, along, 0) + 1) * _TEXELS for along in (v, u))
        dark = drawn[row.astype(int), column.astype(int)] < 128
    return np.where(squares & dark, _BLACK, np.where(paper, _WHITE, _AROUND))


def grey(source: Camera, reflectance: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Image, (h, w, 3) float32, of a grey scene given along rays (x, y, 1), averaged over each pixel."""
    total = np.zeros((source.height, source.width))
    for k in range(_SUB * _SUB):
        columns = np.arange(source.width) + (k % _SUB + 0.5) / _SUB
        rows = np.arange(source.height) + (k // _SUB + 0.5) / _SUB
        x, y = np.meshgrid((columns - source.cx) / source.fx, (rows - source.cy) / source.fy)
        total += reflectance(x, y)
    return np.repeat((total / _SUB**2)[..., None], 3, axis=2).astype(np.float32)


def even(planes: Optics, value: float = 1.0) -> np.ndarray:
    """Image of an even wall (or, with 0, of nothing): (h, w, 3) float32."""
    return np.full((planes.source.height, planes.source.width, 3), value, np.float32)


def grey_card(planes: Optics) -> np.ndarray:
    """Image of a grey card that fills the middle 60 % of the frame, before a brown wall: (h, w, 3) float32."""
    image = even(planes) * np.array((0.4, 0.25, 0.15), np.float32)
    height, width = image.shape[:2]
    rows, columns = (slice(round(0.2 * size), round(0.8 * size)) for size in (height, width))
    image[rows, columns] = 1.0
    return image
