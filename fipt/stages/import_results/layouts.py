"""Files of another program -> layers of ours."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz
from fipt.formats.exr import read_exr
from fipt.stages.import_results.files import DEPTH, OtherResults

_NPZ = {"albedo": "reflectance", "diffuse": "kd", "roughness": "roughness", "emission": "emission", "depth": DEPTH}
"""Their quantity -> our layer."""
_SCALARS = ("roughness", DEPTH)
_ROUNDING = 0.01
"""Below zero by so much: noise of networks and filters."""
_MOST = {"roughness": 1 + _ROUNDING, "reflectance": 100.0, "kd": 100.0}
"""Reflectances may be known up to a factor; those of 0 to 255 are refused."""


def layers_of(found: OtherResults, view: str, shape: tuple[int, int]) -> dict[str, np.ndarray]:
    """Our layers of a view: (H, W, 3) or (H, W) float32, of its size.

    Raises
    ------
    FiptError
        If a file is damaged, of another size, or holds values that are not finite.
    """
    return {name: _checked(values, name, path, shape) for name, values, path in _stored(found, view)}


def _stored(found: OtherResults, view: str) -> Iterator[tuple[str, np.ndarray, Path]]:
    for name, files in found.materials.items():
        path = files[view]
        if name != "npz":
            yield name, _read_image(path, name in _SCALARS), path
            continue
        arrays = load_npz(path)
        if not _NPZ.keys() & arrays.keys():
            there = ", ".join(sorted(arrays)) or "nothing"
            raise FiptError(f"{path} must hold one of {', '.join(_NPZ)}; it holds {there}", "name its arrays so")
        for theirs, ours in _NPZ.items():
            if theirs in arrays:
                yield ours, arrays[theirs], path


def image_of(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """(H, W, 3) image; FiptError as in `layers_of`."""
    return _checked(_read_image(path, scalar=False), "image", path, shape)


def _read_image(path: Path, scalar: bool) -> np.ndarray:
    channels = read_exr(path)
    for letters in ("RGB", "Y"):
        if all(letter in channels for letter in letters):
            values = np.stack([channels[letter] for letter in letters], axis=-1)
            return values[..., 0] if scalar else np.broadcast_to(values, (*values.shape[:2], 3))
    raise FiptError(f"{path} must have channels R, G, B or Y; found {', '.join(sorted(channels))}", "export it again")


def _checked(values: np.ndarray, name: str, path: Path, shape: tuple[int, int]) -> np.ndarray:
    if name in _SCALARS and values.ndim == 3 and values.shape[2] in (1, 3):
        values = values[..., 0]
    wanted = shape if name in _SCALARS else (*shape, 3)
    if values.shape != wanted:
        raise FiptError(
            f"{path}: {name} must have shape {wanted} like its view; it has {values.shape}", "export it at that size"
        )
    if values.dtype.kind != "f":
        raise FiptError(f"{path}: {name} must hold floats; found {values.dtype}", "export it again, 1 for white")
    values = values.astype(np.float32)
    if not np.isfinite(values).all():
        raise FiptError(f"{path}: {name} must be finite; found NaN or infinity", "export it again")
    bad = int((values < -_ROUNDING).sum() + (values > _MOST.get(name, np.inf)).sum())
    if bad:
        most = f"and {_MOST[name]:g}" if name in _MOST else "and any number"
        raise FiptError(
            f"{path}: {name} must lie between 0 {most}; {bad} values do not", "export it again, 1 for white"
        )
    return values


def scaled_to(values: np.ndarray, truth: np.ndarray, counted: np.ndarray | None = None) -> np.ndarray:
    """Values times the factor that gives them the energy of the truth over its darkest 95 %; (H, W, 3) both.

    Pixels that are not ``counted`` (H, W) bool do not matter.
    """
    use = np.ones(truth.shape, bool) if counted is None else np.broadcast_to(counted[..., None], truth.shape)
    if not use.any():
        return values
    dark = use & (truth <= np.quantile(truth[use], 0.95))
    energy = float(values[dark].sum(dtype=np.float64))
    return values * np.float32(truth[dark].sum(dtype=np.float64) / energy) if energy > 0 else values
