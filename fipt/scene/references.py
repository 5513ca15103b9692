"""Photographs of a room under another light, with which its relit views are compared."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.conventions import FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.hdr import read_hdr
from fipt.scene.cameras import Camera
from fipt.scene.dataset import check_image

_ENDINGS = (".exr", ".hdr")


def find_references(folder: str | Path, views: Sequence[str]) -> dict[str, Path]:
    """View -> its photograph, of the views that have one."""
    paths = [(view, Path(folder, view + ending)) for ending in reversed(_ENDINGS) for view in views]
    return {view: path for view, path in paths if path.is_file()}  # of two, the EXR


def reference_files(folder: str | Path, views: Sequence[str]) -> dict[str, Path]:
    """View -> its photograph.

    Raises
    ------
    FiptError
        If no view has one.
    """
    found = find_references(folder, views)
    if not found:
        if not views:
            raise FiptError(f"no held-out view can be compared with {folder}", "hold some views out, or leave it away")
        raise FiptError(
            f"the reference {folder} must hold photographs named as the relit views; none of "
            f"{', '.join(view + _ENDINGS[0] for view in views[:3])} is there (EXR or HDR)",
            "correct the folder, or name its files as the views",
        )
    return found


def read_reference(path: Path, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Linear RGB (H, W, 3) of any exposure, and weights (H, W): 0 where the file says so, or that it is clipped.

    Raises
    ------
    FiptError
        If the size is not the camera's, or pixels with weight are NaN, infinite or negative.
    """
    channels: dict[str, np.ndarray] = {}
    if path.suffix == ".hdr":
        image = read_hdr(path)
    else:
        channels = read_exr(path, required=("R", "G", "B"))
        image = np.stack([channels[letter] for letter in "RGB"], axis=-1)
    valid = np.clip(channels.get("valid.Y", np.ones(image.shape[:2], np.float32)), 0.0, 1.0)
    if "flags.Y" in channels:
        valid = valid * ((channels["flags.Y"].astype(np.uint32) & FLAG_SATURATED) == 0)
    check_image(image, valid, camera, path)
    return np.where(valid[..., None] > 0, image, 0.0).astype(np.float32), valid
