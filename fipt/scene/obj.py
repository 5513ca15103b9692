"""Wavefront OBJ: positions and faces in the order of the file, and whether it is whole."""

import logging
import re
from itertools import pairwise
from pathlib import Path

import numpy as np

log = logging.getLogger(__name__)

_COUNT = re.compile(r"#\s*(?:number of\s+)?(vertices|faces|triangles):\s*(\d+)\s*", re.IGNORECASE)
"""What Open3D and MeshLab write of a file."""
_ITEMS = ("v", "vt", "vn", "f")


class CutFileError(ValueError):
    """A file that ends before its end."""


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read positions (V, 3) float64 and triangles (T, 3) int32, of polygons a fan (trimesh orders them by material).

    Raises
    ------
    ValueError
        If a vertex has fewer than three numbers, or a face fewer than three corners.
    CutFileError
        If the file is cut, as far as that can be known.
    """
    vertices: list[list[str]] = []
    triangles: list[tuple[int, int, int]] = []
    announced: dict[str, int] = {}
    line, face, before, faces = "", [""], [""], 0
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                if len(words) < 4:
                    raise ValueError(f"vertex {len(vertices)} has {len(words) - 1} coordinates")
                vertices.append(words[1:4])
            elif words[:1] == ["f"]:
                numbers = [int(word.partition("/")[0]) for word in words[1:]]
                if len(numbers) < 3:
                    raise ValueError(f"face {faces} has {len(numbers)} vertices")
                # Numbers count from 1, negative ones backwards from the vertex read last.
                first, *rest = (n - 1 if n > 0 else len(vertices) + n for n in numbers)
                triangles += [(first, b, c) for b, c in pairwise(rest)]
                before, face, faces = face, words[1:], faces + 1
            elif found := _COUNT.fullmatch(line):
                announced[found[1].lower()] = int(found[2])
    there = {"vertices": len(vertices), "faces": len(triangles), "triangles": len(triangles)}
    for what, count in announced.items():
        if there[what] < count:
            raise CutFileError(f"it is cut: it announces {count} {what}, and holds {there[what]}")
    made = np.array(vertices, np.float64).reshape(-1, 3), np.array(triangles, np.int32).reshape(-1, 3)
    if not line.endswith(("\n", "\r")) and line.split()[:1] and line.split()[0] in _ITEMS:
        _check_end(path, line, len(np.unique(made[1])) < len(vertices), _form(face) == _form(before) or faces < 2)
    return made


def check_whole(path: Path) -> None:
    """Raise CutFileError if a file is cut, as far as that can be known; what else is wrong, its reader says."""
    try:
        read_obj(path)
    except CutFileError:
        raise
    except ValueError as error:
        log.debug("%s: %s", path, error)


def _check_end(path: Path, line: str, unused: bool, alike: bool) -> None:
    """Judge a file whose last line has no end: refuse it if more is missing, else warn.

    Parameters
    ----------
    unused
        Some vertex belongs to no face.
    alike
        The last face is written as the one before.
    """
    shown = repr(line if len(line) < 60 else f"{line[:57]}...")
    if unused or not alike or not line.startswith("f"):
        why = "vertices follow the last face" if not line.startswith("f") else "some vertices belong to no face"
        why = why if alike else "the face before is written in another form"
        raise CutFileError(f"it is cut: its last line, {shown}, has no end, and {why}")
    log.warning("%s may be cut: its last line, %s, has no end; end it if it is whole", path, shown)


def _form(face: list[str]) -> tuple[int, set[str]]:
    """How a face is written: its corners, and which of their numbers are given."""
    return len(face), {re.sub(r"-?\d+", "n", word) for word in face}
