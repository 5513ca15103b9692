"""What the readers of layouts share: a view as a source states it, and matrices as rows of numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

Matrix = tuple[tuple[float, ...], ...]
"""Rows of numbers; plans are made without NumPy."""


@dataclass(frozen=True)
class SourceView:
    """One view of a source, nothing of it opened yet.

    Attributes
    ----------
    name, split
        View name in the dataset, and ``train`` or ``val``; empty where the source has no split.
    image
        Its file.
    world_from_camera
        4x4 rows, OpenGL axes, the source's units (metres).
    intrinsics
        What the source says of w, h, fl_x, fl_y, cx, cy (pixels), camera_angle_x, _y (radians) and, of views that are
        photographs, of distortion.
    mask
        An 8-bit image, 0 where pixels are not to be used.
    depth
        A depth map that exists: EXR in metres, or PNG of 16 bits.
    folder, number
        FIPT layouts: where folders like ``Image`` and ``DiffCol`` lie, and the view's number there.
    dataset
        A dataset of this program: its folder, with truth/ and segments/.
    applied
        4x4 rows, a similarity by which the source says that its world came from an original one; None: from none.
    """

    name: str
    split: str
    image: Path
    world_from_camera: Matrix
    intrinsics: Mapping[str, float]
    mask: Path | None = None
    depth: Path | None = None
    folder: Path | None = None
    number: str = ""
    dataset: Path | None = None
    applied: Matrix | None = None


@dataclass(frozen=True)
class PosedViews:
    """What a reader finds in a source.

    Attributes
    ----------
    views
        In the source's order; none opened yet.
    mesh
        Its mesh where the layout names one; it need not be there. None: the user names it.
    root
        Folder of the source.
    """

    views: tuple[SourceView, ...]
    mesh: Path | None
    root: Path


def numbered_file(folder: Path, number: str) -> Path:
    """File of a numbered view in a FIPT folder: NNN_0001.exr, or NNN.exr where only that exists."""
    short, long = folder / f"{number}.exr", folder / f"{number}_0001.exr"
    return short if short.is_file() and not long.is_file() else long


def number(value: object) -> float:
    """A number of a source; a truth value is none, though Python takes it for 0 or 1."""
    if isinstance(value, bool):
        raise ValueError(f"a number must stand where {str(value).lower()} does")
    return float(value)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType] - what is no number raises


def pose_matrix(rows: Sequence[Sequence[float]], flip: Sequence[int] = (1, 1, 1)) -> Matrix:
    """A 3x4 or 4x4 camera-to-world matrix as 4x4, camera axes multiplied by ``flip``."""
    if len(rows) not in (3, 4) or any(len(row) != 4 for row in rows):
        raise ValueError("transform_matrix must be 3x4 or 4x4")
    last = [number(x) for x in rows[3]] if len(rows) == 4 else [0, 0, 0, 1]
    if any(abs(x - wanted) > 1e-6 for x, wanted in zip(last, (0, 0, 0, 1), strict=True)):
        raise ValueError(f"the last row of transform_matrix must be 0, 0, 0, 1; found {last}: is it transposed?")
    signs = (*flip, 1)
    top = [tuple(number(x) * sign for x, sign in zip(row, signs, strict=True)) for row in rows[:3]]
    return (*top, (0.0, 0.0, 0.0, 1.0))
