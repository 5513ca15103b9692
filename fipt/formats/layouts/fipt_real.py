"""The published real rooms of FIPT: cam.txt (origin, look-at point, up), K_list.txt, numbered EXR files."""

import math
from collections.abc import Sequence
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.layouts.common import Matrix, PosedViews, SourceView, numbered_file
from fipt.formats.text import MALFORMED, read_text


def read_fipt_real(root: Path) -> PosedViews:
    """Read cam.txt and K_list.txt; cameras have y down and look along +z."""
    poses, calibrations = _triples(root / "cam.txt"), _triples(root / "K_list.txt")
    if len(poses) != len(calibrations):
        raise FiptError(
            f"{root}: cam.txt and K_list.txt must hold as many cameras; found {len(poses)} and {len(calibrations)}",
            "correct the lists",
        )
    frames = []
    for index, (pose, k) in enumerate(zip(poses, calibrations, strict=True)):
        number = f"{index:03d}"
        if abs(k[0][1]) > 1e-6 * abs(k[0][0]):
            raise FiptError(
                f"{root / 'K_list.txt'}, camera {index}: skew must be zero; found {k[0][1]}",
                "undistort the images first",
            )
        intrinsics = {"fl_x": k[0][0], "fl_y": k[1][1], "cx": k[0][2], "cy": k[1][2]}
        image = numbered_file(root / "Image", number)
        matrix = _look_at(f"{root / 'cam.txt'}, camera {index}", *pose)
        frames.append(SourceView(number, "", image, matrix, intrinsics, folder=root, number=number))
    return PosedViews(tuple(frames), root / "scene.obj", root)


def _triples(path: Path) -> list[Matrix]:
    """Read a count, then three lines of three numbers for each camera."""
    lines = [line.split() for line in read_text(path, "the camera list").splitlines() if line.strip()]
    try:
        (count,) = (int(float(text)) for text in lines[0])
        rows = [tuple(map(float, line)) for line in lines[1:]]
    except MALFORMED as error:
        raise FiptError(
            f"{path} must hold a count, then lines of three numbers ({error})", "correct the list"
        ) from error
    if len(rows) != 3 * count or any(len(row) != 3 for row in rows):
        raise FiptError(
            f"{path} must hold 3 lines of three numbers for each of {count} cameras; it holds {len(rows)} lines",
            "correct the list",
        )
    return [tuple(rows[start : start + 3]) for start in range(0, len(rows), 3)]


def _look_at(where: str, origin: Sequence[float], at: Sequence[float], up: Sequence[float]) -> Matrix:
    """World from an OpenGL camera at ``origin`` that looks at ``at``; ``up`` need not be square."""
    forward = _unit(where, [a - o for a, o in zip(at, origin, strict=True)])
    right = _unit(where, _cross(forward, up))
    above = _cross(right, forward)
    rows = zip(right, above, forward, origin, strict=True)
    return (*((r, u, -f, float(o)) for r, u, f, o in rows), (0.0, 0.0, 0.0, 1.0))


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _unit(where: str, vector: Sequence[float]) -> list[float]:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and length > 1e-9):
        raise FiptError(f"{where}: origin, look-at point and up must span a camera", "correct the pose")
    return [x / length for x in vector]
