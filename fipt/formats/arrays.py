"""Arrays on disk: npy (memory-mapped) and npz, never pickled."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from fipt.errors import FiptError, unreadable
from fipt.formats.files import atomic, existing_file, made_again, nameless
from fipt.formats.origins import check_origin, origin


def save_npy(path: str | Path, array: np.ndarray) -> None:
    """Write ``array`` (any shape, no objects) as npy."""
    with atomic(path) as temporary, open(temporary, "wb") as file:
        np.save(file, np.ascontiguousarray(array), allow_pickle=False)


def load_npy(path: str | Path, mmap: bool = True) -> np.ndarray:
    """Read an npy file, memory-mapped read-only unless ``mmap`` is false.

    Raises
    ------
    FiptError
        If the file is missing or not a plain npy array.
    """
    existing_file(path, "an array file")
    try:
        if mmap:
            return np.lib.format.open_memmap(path, mode="r")
        with open(path, "rb") as file:
            return np.lib.format.read_array(file, allow_pickle=False)
    except Exception as error:  # an absurd header raises kinds of its own: OverflowError, SyntaxError, MemoryError
        # numpy takes whatever it does not know for a pickle, and says how to load one.
        why = "" if "pickle" in str(error) else f" ({error})"
        raise unreadable(path, error, f"is not a complete npy array{why}", made_again(path)) from error


def on_disk(folder: str | Path) -> Callable[[tuple[int, ...], DTypeLike], np.ndarray]:
    """Return a function like ``np.empty(shape, dtype)`` whose arrays lie in files without a name in ``folder``.

    The system moves them in and out of memory, and removes them when the process ends.
    """

    def empty(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
        size = int(np.prod(shape)) * np.dtype(dtype).itemsize
        if size == 0:
            return np.empty(shape, dtype)
        with nameless(folder, size) as file:
            return np.memmap(file, dtype, "r+", shape=shape)

    return empty


_ORIGIN = "_origin"
"""Array of an npz file that says of which mesh and by which stage it was made, JSON."""


def save_npz(path: str | Path, **arrays: np.ndarray) -> None:
    """Write named arrays (any shape, no objects) as npz (uncompressed), and of what they were made."""
    for name, array in arrays.items():
        if np.asarray(array).dtype.hasobject:  # numpy would pickle it
            raise ValueError(f"{name} holds objects; nothing is pickled")
    if made_of := origin():
        arrays[_ORIGIN] = np.array(json.dumps(made_of, sort_keys=True))
    with atomic(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType] - none is called allow_pickle


_Test = Callable[[np.ndarray], np.ndarray | np.bool_]
_KINDS: dict[str, tuple[str, _Test, str]] = {
    "int": ("iu", lambda _: np.True_, ""),
    "number": ("iu", lambda array: array >= 0, "some below 0"),
    "rising": ("iu", lambda array: np.append(array >= 0, np.diff(array.astype(np.int64)) > 0), "not rising from 0"),
    "float": ("fiu", lambda _: np.True_, ""),
    "finite": ("fiu", np.isfinite, "not all finite"),
    "amount": ("fiu", lambda array: np.isfinite(array) & (array >= 0), "not all finite and >= 0"),
    "share": ("fiu", lambda array: (array >= 0) & (array <= 1 + 1e-5), "not all from 0 to 1"),
    "bool": ("biu", lambda _: np.True_, ""),
    "text": ("U", lambda _: np.True_, ""),
}
"""Word of a form -> kinds of numpy's types that fit, what must hold of all values, what to say where it does not."""


def load_npz(
    path: str | Path, required: Sequence[str] = (), forms: Mapping[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Read all arrays of an npz file.

    Parameters
    ----------
    forms
        Array -> type and shape that it must have, such as ``finite N 3`` or ``int N``; a letter is one length in all.

    Raises
    ------
    FiptError
        If the file is missing or damaged, or was made of another mesh than the running stage reads; if one of the
        ``required`` arrays is not in it, or one has another form.
    """
    existing_file(path, "an array file")
    try:
        # Opened here: numpy leaves the file open where it is damaged.
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        made_of = json.loads(str(arrays.pop(_ORIGIN))) if _ORIGIN in arrays else None
    except Exception as error:  # zipfile, zlib and numpy each raise their own kinds for a damaged file
        why = "" if "pickle" in str(error) else f" ({error})"
        raise unreadable(path, error, f"is not a complete npz file{why}", made_again(path)) from error
    check_origin(path, made_of)
    wanted: dict[str, str] = dict.fromkeys(required, "") | dict(forms or {})
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise FiptError(f"{path} lacks the arrays {', '.join(missing)}", "give the file of the stage that writes them")
    lengths: dict[str, int] = {}
    for name, form in (forms or {}).items():
        if found := _misfit(arrays[name], form, lengths):
            raise FiptError(f"{path}: the array {name} must be {form}; found {found}", made_again(path))
    return arrays


def _misfit(array: np.ndarray, form: str, lengths: dict[str, int]) -> str:
    """What an array is that does not have its form; empty where it has. Lengths that letters stand for are kept."""
    word, *shape = form.split()
    kinds, holds, otherwise = _KINDS[word]
    sizes = [lengths.setdefault(size, found) for size, found in zip(shape, array.shape, strict=False)]
    sizes = [int(size) if size.isdigit() else known for size, known in zip(shape, sizes, strict=False)]
    if array.dtype.kind not in kinds or len(shape) != array.ndim or tuple(sizes) != array.shape:
        return f"{array.dtype} {array.shape}"
    return "" if np.all(holds(array)) else f"{array.dtype} {array.shape}, {otherwise}"
