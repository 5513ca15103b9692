"""Boards of known size in the views: where they stand in a reconstruction, hence how large its unit is."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.progress import progress
from fipt.scene.cameras import Camera
from fipt.stages.poses.settings import SceneBoard
from fipt.stages.poses.similarity import fit_similarity
from fipt.stages.poses.triangulate import triangulate

if TYPE_CHECKING:
    import cv2

ReadImage = Callable[[str], np.ndarray]
"""View -> (H, W, 3) linear radiance."""

_LEAST = 4
"""Corners of a ChArUco board that must be found in a view."""

_WHITES = (99.5, 90.0, 60.0)
"""Percentiles of the luminance that become white: a board may lie in the light or in the dark."""

_MAGNIFIED = 3500
"""Width up to which images are searched at twice and four times their size too: small markers are found there."""

_BIG = 0.3
"""Residual in pixels below which no view counts as wrong, however good the others are."""


@dataclass(frozen=True)
class Target:
    """A rigid set of corners of known size, and where views show them.

    Attributes
    ----------
    name
        ``board``, or ``tag N``.
    points
        (K, 3) float64 corners, metres; in the plane z = 0.
    seen
        View -> ((N,) numbers of corners, (N, 2) pixels).
    """

    name: str
    points: np.ndarray
    seen: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


@dataclass(frozen=True)
class PlacedTarget:
    """A target in the reconstruction: x = scale rotation corner + shift.

    Attributes
    ----------
    name
        Of the target.
    scale
        Units of the reconstruction in a metre.
    deviation
        Relative standard deviation of the scale that the residuals imply.
    rotation, shift
        (3, 3) and (3,).
    pixels, millimetres
        Root mean square residual in the images; median distance of corners triangulated on their own.
    views, rejected
        Views that were used, and those that contradict them.
    corners
        (K, 3) corners in the reconstruction.
    """

    name: str
    scale: float
    deviation: float
    rotation: np.ndarray
    shift: np.ndarray
    pixels: float
    millimetres: float
    views: tuple[str, ...]
    rejected: tuple[str, ...]
    corners: np.ndarray


def find_boards(cameras: Sequence[Camera], read_image: ReadImage, board: SceneBoard) -> list[Target]:
    """Look for the board, or for tags, in every view at its full resolution.

    Raises
    ------
    FiptError
        If no view shows it.
    """
    from fipt.scene import boards

    markers = boards.dictionary(board.dictionary, "poses.align.board.dictionary")
    targets: dict[int, Target] = {}
    charuco = None
    if board.kind == "charuco":
        if board.marker >= board.square:
            raise FiptError(
                f"poses.align.board.marker must be smaller than square; found {board.marker:g} and {board.square:g}",
                "measure both on the board",
            )
        charuco = boards.charuco_board((board.columns, board.rows), board.square, board.marker, markers)
        targets[0] = Target("board", np.array(charuco.getChessboardCorners(), np.float64))
    with progress("boards", len(cameras), " views") as bar:
        for camera in cameras:
            radiance = read_image(camera.name)
            if charuco is not None:
                corners = _charuco(radiance, charuco)
                if corners is not None:
                    targets[0].seen[camera.name] = corners
            else:
                for grey, size in _images(radiance, 1.0):
                    for number, corners in boards.tag_corners(grey, markers).items():
                        new = Target(f"tag {number}", boards.tag_points(board.marker).astype(np.float64))
                        seen = targets.setdefault(number, new).seen
                        seen.setdefault(camera.name, (np.arange(4), corners.astype(np.float64) / size))
            bar.advance(1, camera.name)
    found = [targets[number] for number in sorted(targets) if targets[number].seen]
    if not found:
        sizes = sorted({f"{camera.width}x{camera.height}" for camera in cameras})
        what = (
            f"ChArUco board of {board.columns}x{board.rows} inner corners ({board.dictionary})"
            if board.kind == "charuco"
            else f"marker of {board.dictionary}"
        )
        names = ", ".join(camera.name for camera in cameras)
        raise FiptError(
            f"no {what} was found in any of {len(cameras)} views at {', '.join(sizes)} pixels: {names}",
            "check poses.align.board against the board; a marker must be sharp and at least 15 pixels wide",
        )
    return found


def _charuco(radiance: np.ndarray, board: "cv2.aruco.CharucoBoard") -> tuple[np.ndarray, np.ndarray] | None:
    """Numbers (N,) and pixels (N, 2) of a board's corners in a view; None where it is not seen."""
    from fipt.scene import boards

    ids, pixels = np.empty(0, np.int32), np.empty((0, 2))
    for grey, size in _images(radiance, 0.5):
        found = boards.charuco_corners(grey, board, _LEAST, beside=1)
        if found is not None and len(found[2]) > len(ids):
            ids, pixels = found[2], found[1].astype(np.float64) / size
    if len(ids) == 0:
        return None
    matched = [boards.board_corners(grey, board, pixels, ids) for grey in toned(radiance, 1.0)]
    best = max((match for match in matched if match is not None), key=lambda match: match[2], default=None)
    return (ids, pixels) if best is None else (best[1], best[0])


def _images(radiance: np.ndarray, power: float) -> Iterator[tuple[np.ndarray, int]]:
    """Grey images to search, and how many times larger than the view they are.

    Where the light is averaged over a pixel on an edge, a tone curve moves the edge into the dark: nothing to the
    corners between four squares, but a dark tag shrinks (by 1 % where it is 50 pixels wide).
    """
    import cv2

    images = toned(radiance, power)
    yield from ((grey, 1) for grey in images)
    for size in (2, 4):
        if radiance.shape[1] * size <= _MAGNIFIED:
            yield from ((cv2.resize(g, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC), size) for g in images)


def toned(radiance: np.ndarray, power: float = 0.5) -> list[np.ndarray]:
    """Grey images of (H, W, 3) radiance at several exposures, with a power as tone curve: (H, W) uint8."""
    light = np.maximum(np.asarray(radiance, np.float32) @ np.array(LUMINANCE, np.float32), 0)
    whites = np.percentile(light[::2, ::2], _WHITES)
    return [(np.clip(light / max(white, 1e-12), 0, 1) ** power * 255 + 0.5).astype(np.uint8) for white in whites]


def place(target: Target, cameras: Mapping[str, Camera]) -> PlacedTarget | None:
    """Find the similarity that brings a target's corners onto its pixels in all views; None if too little is seen.

    Corners seen twice are triangulated and give a start; the result minimises a robust sum of reprojection errors.
    Views that contradict the others (wrong cameras) are left out.
    """
    views = [view for view in target.seen if view in cameras]
    located = _triangulated(target, views, cameras)
    if len(located) < 3:
        return None
    ids = np.array(sorted(located))
    first = fit_similarity(target.points[ids], np.array([located[i] for i in ids]))
    size = float(np.cbrt(np.linalg.det(first[:3, :3])))
    start = (size, first[:3, :3] / size, first[:3, 3])
    used = list(views)
    while True:
        solved = _solve(target, used, cameras, start)
        worst = {view: float(np.median(np.linalg.norm(_errors(target, [view], cameras, solved[0]), axis=1)))
                 for view in used}  # fmt: skip
        wrong = max(used, key=worst.__getitem__)
        others = [worst[view] for view in used if view != wrong]
        # Two views cannot say which of them is wrong.
        if len(used) <= 2 or worst[wrong] <= max(_BIG, 5 * float(np.median(others))):
            break
        used.remove(wrong)
        start = solved[0]
    (scale, rotation, shift), deviation = solved
    errors = _errors(target, used, cameras, solved[0])
    corners = scale * target.points @ rotation.T + shift
    located = _triangulated(target, used, cameras)
    misses = [np.linalg.norm(point - corners[i]) / scale * 1000 for i, point in located.items()]
    return PlacedTarget(
        target.name, scale, deviation, rotation, shift, float(np.sqrt((errors**2).sum(axis=1).mean())),
        float(np.median(misses)) if misses else float("nan"), tuple(used),
        tuple(view for view in views if view not in used), corners,
    )  # fmt: skip


def _triangulated(target: Target, views: Sequence[str], cameras: Mapping[str, Camera]) -> dict[int, np.ndarray]:
    """Corner -> its place in the reconstruction, of corners that two views see from different places."""
    seen: dict[int, list[tuple[Camera, np.ndarray]]] = {}
    for view in views:
        for number, pixel in zip(*target.seen[view], strict=True):
            seen.setdefault(int(number), []).append((cameras[view], pixel))
    places = {}
    for number, observed in seen.items():
        if len(observed) > 1:
            found = triangulate([camera for camera, _ in observed], np.array([pixel for _, pixel in observed]))
            if found.parallax > 0.2:
                places[number] = found.position
    return places


Similarity = tuple[float, np.ndarray, np.ndarray]


def _solve(
    target: Target, views: Sequence[str], cameras: Mapping[str, Camera], start: Similarity
) -> tuple[Similarity, float]:
    """Similarity with the least reprojection errors, and the relative standard deviation of its scale."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    reach = float(np.linalg.norm(start[2])) + start[0]

    def similarity(x: np.ndarray) -> Similarity:
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        return start[0] * float(np.exp(x[6])), turn @ start[1], start[2] + reach * x[3:6]

    def errors(x: np.ndarray) -> np.ndarray:
        return _errors(target, views, cameras, similarity(x)).ravel()

    best = least_squares(errors, np.zeros(7), loss="soft_l1", f_scale=0.5, x_scale="jac")
    noise = float((errors(best.x) ** 2).sum()) / max(len(best.fun) - 7, 1)
    covariance = np.linalg.pinv(best.jac.T @ best.jac, hermitian=True) * noise
    return similarity(best.x), float(np.sqrt(max(covariance[6, 6], 0.0)))


def _errors(target: Target, views: Sequence[str], cameras: Mapping[str, Camera], similarity: Similarity) -> np.ndarray:
    """(M, 2) pixels between projected and observed corners of some views."""
    scale, rotation, shift = similarity
    corners = scale * target.points @ rotation.T + shift
    return np.concatenate([cameras[v].project(corners[target.seen[v][0]])[0] - target.seen[v][1] for v in views])
