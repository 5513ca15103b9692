"""What the import leaves out of photographs: pixels that show dark things which the mesh lacks."""

import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fipt.formats.exr import read_exr, write_exr
from fipt.formats.files import check_memory
from fipt.scene.blocks import is_bound
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.stages.importing.frames import written_radiance

log = logging.getLogger(__name__)

_BYTES_A_PIXEL = 40
"""Of memory for a pixel of any view while views are compared: measured 35."""
_NAMED = 3
"""Views that a warning names."""


def mask_occluders(folder: Path, mesh: Mesh, cameras: Sequence[Camera]) -> tuple[float, list[str]]:
    """Give no weight to pixels of written views that show what the mesh lacks; Mitsuba's variant must be set.

    Returns
    -------
    share
        Of the pixels of all views.
    warnings
        Of views that are darker than the others in so many places that nothing is left out of them.
    """
    from fipt.meshing.occluders import occluded

    pixels = sum(camera.width * camera.height for camera in cameras)
    advice = "use smaller images, or set import.mask_occluders: false"
    check_memory(_BYTES_A_PIXEL * pixels, "the search for what the mesh lacks", advice)
    masks, odd = occluded(mesh, cameras, partial(_measured, folder))
    for camera, mask in zip(cameras, masks, strict=True):
        if mask.any():
            _without(folder / "images" / f"{camera.name}.exr", mask)
    share = sum(int(mask.sum()) for mask in masks) / max(pixels, 1)
    log.info("%.2f %% of the training pixels show something dark before the mesh, and are left out", 100 * share)
    return round(share, 5), _warnings(odd)


def _measured(folder: Path, view: str) -> tuple[np.ndarray, np.ndarray]:
    """The (H, W, 3) radiance of a view and its (H, W) weights, 0 where it is only a lower bound."""
    radiance, valid = written_radiance(folder, view)
    flags = read_exr(folder / "images" / f"{view}.exr").get("flags.Y")
    return radiance, valid if flags is None else np.where(is_bound(flags.astype(np.uint32)), 0.0, valid)


def _without(path: Path, mask: np.ndarray) -> None:
    """Rewrite an image with no weight in a ``mask`` (H, W) bool."""
    channels = read_exr(path, required=("R", "G", "B"))
    valid = channels.get("valid.Y", np.ones(mask.shape, np.float32))
    write_exr(path, {**channels, "valid.Y": np.where(mask, np.float32(0), valid)})


def _warnings(odd: Sequence[str]) -> list[str]:
    if not odd:
        return []
    more = f" and {len(odd) - _NAMED} more" if len(odd) > _NAMED else ""
    return [
        f"far darker than the others in more than a tenth of what both see: {len(odd)} training views "
        f"({', '.join(odd[:_NAMED])}{more}); look at their poses, and at what moved"
    ]
