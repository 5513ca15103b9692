"""A dataset of smaller images: blocks of pixels averaged, cameras with them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.images import read_ids, write_png
from fipt.formats.layouts.own import KINDS, ids_file, truth_file
from fipt.scene.blocks import block_flags, block_ids, block_mean, block_radiance
from fipt.scene.cameras import Camera
from fipt.scene.dataset import read_layers


def downscale(folder: Path, cameras: Sequence[Camera], factor: int) -> list[Camera]:
    """Average the images of a dataset, truth and ids with them, over blocks of ``factor`` pixels a side.

    Radiance is the mean over pixels that count, by weight. Flags of any pixel are those of its block: part of a block
    that is clipped makes a lower bound of it, the mean of all that is known. Truth is the plain mean, an id that of
    most pixels. Pixels that do not fill a block, right and below, are cut off.

    Returns
    -------
    cameras
        Of the smaller images.

    Raises
    ------
    FiptError
        If nothing would be left of an image.
    """
    smaller = []
    for camera in cameras:
        if factor > min(camera.width, camera.height):
            raise FiptError(
                f"import.downscale must leave pixels of every view; {factor} leaves none of view {camera.name} of "
                f"{camera.width}x{camera.height}",
                "choose a smaller factor",
            )
        _rewrite_image(folder / "images" / f"{camera.name}.exr", factor)
        truth = truth_file(folder, camera.name)
        if truth.is_file():
            layers = read_layers(truth)
            write_exr(truth, {k if v.ndim == 3 else f"{k}.Y": block_mean(v, factor) for k, v in layers.items()})
        for path in (ids_file(folder, kind, camera.name) for kind in KINDS):
            if path.is_file():
                write_png(path, block_ids(read_ids(path), factor))
        smaller.append(camera.reduced(factor))
    return smaller


def _rewrite_image(path: Path, factor: int) -> None:
    found = read_exr(path, required=("R", "G", "B"))
    radiance = np.stack([found[letter] for letter in "RGB"], axis=-1)
    valid = found.get("valid.Y", np.ones(radiance.shape[:2], np.float32))
    flags = found.get("flags.Y", np.zeros(valid.shape)).astype(np.uint32)
    channels: dict[str, np.ndarray] = {"": block_radiance(radiance, valid, flags, factor)}
    if "valid.Y" in found:
        channels["valid.Y"] = block_mean(valid, factor)
    if "flags.Y" in found:
        channels["flags.Y"] = block_flags(flags, factor)
    write_exr(path, channels)
