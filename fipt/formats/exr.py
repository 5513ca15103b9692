"""OpenEXR files with named channels: the only module that reads or writes EXR."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError, unreadable
from fipt.formats.files import atomic, check_memory, existing_file

_BYTES_A_CHANNEL = 12
"""Of memory for a pixel's channel while a file is read: measured 12.3 for float32."""


def write_exr(
    path: str | Path, channels: Mapping[str, np.ndarray], half: bool = False, compression: str = "ZIP"
) -> None:
    """Write named channels to one EXR file.

    Parameters
    ----------
    path
        File to write; it appears only when it is complete.
    channels
        Channel name -> (height, width) array; for example ``R``, ``kd.R`` or ``roughness.Y``.
        An (height, width, 3) array under ``name`` is written as ``name.R``, ``name.G``, ``name.B``; under ``""`` as
        ``R``, ``G``, ``B``. uint32 arrays keep their type.
    half
        Store floating-point channels in 16 bits.
    compression
        ``ZIP``, or ``PIZ``: also lossless, and faster to write for large noisy images.
    """
    import OpenEXR

    flat: dict[str, np.ndarray] = {}
    for name, array in channels.items():
        array = np.asarray(array)
        if array.ndim == 3:
            for index, letter in enumerate("RGB"):
                flat[f"{name}.{letter}" if name else letter] = array[..., index]
        else:
            flat[name] = array
    dtype = np.float16 if half else np.float32
    pixels = {
        name: np.ascontiguousarray(array if array.dtype == np.uint32 else array.astype(dtype))
        for name, array in flat.items()
    }
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    with atomic(path) as temporary:
        OpenEXR.File(header, pixels).write(str(temporary))


def read_exr(path: str | Path, required: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Read all channels of an EXR file.

    Returns
    -------
    dict
        Channel name -> (height, width) array, float32 (uint32 for integer channels).

    Raises
    ------
    FiptError
        If the file is missing or damaged, or one of the ``required`` channels is not in it.
    """
    import OpenEXR

    existing_file(path, "an EXR file")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            _check_size(path, file.header())
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
            _check_windows(path, file.header())
    except FiptError:
        raise
    except Exception as error:  # the package raises bare RuntimeError and ValueError
        raise unreadable(path, error, f"is not a readable EXR file ({error})", "replace the file") from error
    shapes = {array.shape for array in channels.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise FiptError(
            f"{path} must have channels of one size; found {sorted(shapes)}", "export it without subsampling"
        )
    missing = [name for name in required if name not in channels]
    if missing:
        raise FiptError(
            f"{path} must have the channels {', '.join(required)}; {', '.join(missing)} not among "
            f"{', '.join(sorted(channels))}",
            "export the image with these channel names",
        )
    return {
        name: array if array.dtype == np.uint32 else array.astype(np.float32, copy=False)
        for name, array in channels.items()
    }


def pixels_of(path: str | Path) -> int:
    """Pixels of an EXR file, by its header alone.

    Raises
    ------
    FiptError
        If the file is missing or damaged.
    """
    import OpenEXR

    existing_file(path, "an EXR file")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            return _pixels(file.header())
    except Exception as error:  # the package raises bare RuntimeError and ValueError
        raise unreadable(path, error, f"is not a readable EXR file ({error})", "replace the file") from error


def _pixels(header: Mapping[str, Any]) -> int:
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    return int(np.prod(high - low + 1))


def _check_size(path: str | Path, header: Mapping[str, Any]) -> None:
    """Refuse an image that needs more memory than there is, before it is decoded."""
    check_memory(_BYTES_A_CHANNEL * len(header["channels"]) * _pixels(header), f"reading {path}", "use smaller images")


def _check_windows(path: str | Path, header: Mapping[str, Any]) -> None:
    """Raise FiptError if a file holds another window of pixels than the one it shows: its camera is of the latter."""
    data, shown = (np.array(header[name]).tolist() for name in ("dataWindow", "displayWindow"))
    if data != shown:
        raise FiptError(
            f"{path}: its data window {data} must be its display window {shown}",
            "export the whole image, without cropping or overscan",
        )


def read_rgb(path: str | Path, layer: str = "") -> np.ndarray:
    """Read the RGB channels of a ``layer`` (the unnamed one by default) as an (height, width, 3) float32 array."""
    names = [f"{layer}.{letter}" if layer else letter for letter in "RGB"]
    channels = read_exr(path, required=names)
    return np.stack([channels[name] for name in names], axis=-1)


def check_marks(path: str | Path, channels: Mapping[str, np.ndarray]) -> None:
    """Raise FiptError where the weights (``valid.Y``) or flags (``flags.Y``) of an image are none."""
    for name, high in (("valid.Y", 1.0), ("flags.Y", 2.0**32 - 1)):
        bad = 0 if name not in channels else int((~((channels[name] >= 0) & (channels[name] <= high))).sum())
        if bad:
            raise FiptError(f"{path}: {name} must lie between 0 and {high:g}; {bad} pixels do not", "write it again")
