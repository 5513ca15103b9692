"""Segment ids of single views, before they are fused: npz with ids and the class of each."""

from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz

LARGEST_ID = 65535
"""Ids are 16-bit, 0 = unknown."""


def write_view_ids(path: str | Path, ids: np.ndarray, classes: np.ndarray) -> None:
    """Write the ids of a view.

    Parameters
    ----------
    ids
        (H, W) uint16; 0 = unknown. They mean nothing in other views.
    classes
        (K,) int32 class of id k, 0 = unknown; K is larger than every id, entry 0 is 0.
    """
    save_npz(path, ids=ids.astype(np.uint16), classes=classes.astype(np.int32))


def read_view_ids(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read what `write_view_ids` wrote: ids (H, W) uint16 and classes (K,) int32.

    Raises
    ------
    FiptError
        If the file is missing, damaged, or an id has no class.
    """
    arrays = load_npz(path, required=("ids", "classes"))
    ids, classes = arrays["ids"], arrays["classes"]
    if ids.ndim != 2 or ids.dtype != np.uint16 or classes.ndim != 1 or int(ids.max(initial=0)) >= len(classes):
        raise FiptError(
            f"{path} must hold ids (H, W) uint16 and the class of each; found {ids.shape} {ids.dtype} up to "
            f"{ids.max(initial=0)}, and {classes.shape} classes",
            "delete it and run fipt segment again",
        )
    check_classes(path, classes)
    return ids, classes


def no_ids(values: np.ndarray) -> np.ndarray:
    """(...) bool: which values (...) are no whole numbers from 0 to 65,535; all of them where they are no numbers."""
    if values.dtype.kind not in "biuf":
        return np.ones(values.shape, bool)
    with np.errstate(invalid="ignore"):
        return ~((values >= 0) & (values <= LARGEST_ID) & (values == np.floor(values)))


def check_classes(path: str | Path, classes: np.ndarray) -> None:
    """Raise FiptError unless the classes (K,) of a file are such as pictures of ids can hold."""
    bad = no_ids(classes)
    if bad.any():
        raise FiptError(
            f"{path}: classes must be whole numbers from 0 to {LARGEST_ID}, 0 = unknown; label {int(np.argmax(bad))} "
            f"has class {classes[bad][0]}",
            "number the classes anew",
        )


def nearest_ids(ids: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(H, W) ids at another ``shape``: those nearest to its pixels' centres."""
    rows, columns = (((np.arange(n) + 0.5) * m / n).astype(int) for n, m in zip(shape, ids.shape, strict=True))
    return ids[rows[:, None], columns]
