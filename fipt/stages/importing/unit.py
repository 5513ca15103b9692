"""The unit of radiance: every dataset has the level of a photographed room, whatever its source's unit is."""

import numpy as np

from fipt.conventions import LUMINANCE, RADIANCE_LEVEL
from fipt.errors import FiptError
from fipt.scene.sources import ImageSource
from fipt.stages.importing.frames import read_image

_VIEWS = 32
"""Views that tell the level at most, spread over their names: the median needs no more."""
_PIXELS = 20_000
"""Pixels of a view that tell it, at most."""


def radiance_scale(source: ImageSource) -> float:
    """Power of two that brings the median luminance of a source's training views to about the level of a room.

    Powers of two change no digit of a pixel: sources whose units differ by one give the same images, bit for bit. The
    level is that of pixels with weight and light.

    Raises
    ------
    FiptError
        If no training view shows any light.
    """
    frames = sorted((frame for frame in source.frames if frame.split == "train"), key=lambda frame: frame.name)
    seen = []
    for frame in frames[:: -(-len(frames) // _VIEWS)]:
        channels, valid = read_image(frame)
        with np.errstate(over="ignore", invalid="ignore"):
            light = (channels[""].astype(np.float64) @ np.array(LUMINANCE)).ravel()
        light = light[(valid.ravel() > 0) & np.isfinite(light) & (light > 0)]
        seen.append(light[:: -(-max(len(light), 1) // _PIXELS)])
    light = np.concatenate(seen)
    if not len(light):
        raise FiptError(
            f"{source.root}: training views must show light; every pixel of {len(seen)} views is black",
            "check the images, their channels and masks",
        )
    return float(2.0 ** np.round(np.log2(RADIANCE_LEVEL / float(np.median(light)))))
