"""A developed view, and what is done to a whole image: undistortion, colour, averaging down."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.scene.blocks import block_flags, block_mean, block_radiance
from fipt.scene.lens import Lens
from fipt.stages.capture.merge import Merged

_BAND = 128
"""Rows undistorted at once: their maps stay in the processor's cache."""

_INVALID = FLAG_SATURATED | FLAG_OUTSIDE | FLAG_MOVED
"""Flags of pixels that have no weight. What is below the noise is dark, and says so."""


@dataclass
class View:
    """A developed view.

    Attributes
    ----------
    radiance
        (H, W, 3) float32 linear RGB.
    valid
        (H, W) float32 weight in [0, 1].
    flags
        (H, W) uint32, bits of `fipt.conventions`.
    lens
        The pinhole camera of the image; None where nothing is known of it.
    floor
        Standard deviation of a dark pixel, in units of radiance; 0 where unknown.
    facts
        For the capture report, plain JSON types.
    """

    radiance: np.ndarray
    valid: np.ndarray
    flags: np.ndarray
    lens: Lens | None
    floor: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)


def undistorted(merged: Merged, radiance: np.ndarray | None, lens: Lens | None) -> View:
    """Bring a merged bracket to a pinhole camera; decode its radiance unless it is given."""
    flags = merged.noisy * np.uint8(FLAG_NOISE)
    flags |= merged.saturated * np.uint8(FLAG_SATURATED)
    flags |= merged.moved * np.uint8(FLAG_MOVED)
    # Demosaicing spreads a clipped pixel to its neighbours: they have no weight, though their radiance is no bound.
    valid = cv2.erode(((flags & _INVALID) == 0).view(np.uint8) * np.uint8(255), np.ones((3, 3), np.uint8))
    if lens is None:
        radiance = cv2.LUT(merged.codes, merged.table[None]) if radiance is None else radiance
        return View(radiance, valid / np.float32(255), flags.astype(np.uint32), None, merged.floor)
    pinhole = pinhole_of(lens)
    source = merged.codes if radiance is None else radiance
    view = View(
        np.empty((*valid.shape, 3), np.float32),
        np.empty(valid.shape, np.float32),
        np.empty(valid.shape, np.uint32),
        pinhole,
        merged.floor,
    )
    for top in range(0, pinhole.height, _BAND):
        rows = slice(top, min(top + _BAND, pinhole.height))
        maps = lens_maps(lens, replace(pinhole, height=rows.stop - top, cy=pinhole.cy - top))
        seen = cv2.remap(source, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        view.radiance[rows] = cv2.LUT(seen, merged.table[None]) if radiance is None else seen
        view.flags[rows] = cv2.remap(flags, *maps, cv2.INTER_NEAREST, borderValue=FLAG_OUTSIDE)
        view.valid[rows] = cv2.remap(valid, *maps, cv2.INTER_LINEAR, borderValue=0)
    view.valid /= 255
    return view


def pinhole_of(lens: Lens) -> Lens:
    """The camera of undistorted images: square pixels, the principal point in the middle, no distortion."""
    f = float(np.sqrt(lens.fx * lens.fy))
    return Lens(lens.width, lens.height, f, f, lens.width / 2, lens.height / 2)


def lens_maps(lens: Lens, pinhole: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Where each pixel of the pinhole image lies in the photograph, for `cv2.remap`: two (H, W) float32."""
    size = (pinhole.width, pinhole.height)
    return cv2.initUndistortRectifyMap(lens.matrix, np.array(lens.distortion), None, pinhole.matrix, size, cv2.CV_32FC1)


def to_srgb(radiance: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Linear sRGB from white-balanced camera RGB."""
    if np.abs(matrix - np.eye(3)).max() < 1e-4:
        return radiance
    return cv2.transform(radiance, matrix.astype(np.float32))


def downscaled(view: View, factor: int) -> View:
    """Average radiance by weight, and weights, over blocks of pixels.

    A block has the flags of any of its pixels, but for noise.
    """
    if factor > min(view.valid.shape):
        raise FiptError(f"capture.downscale {factor} leaves nothing of {view.valid.shape[1]}x{view.valid.shape[0]}")
    lens = view.lens.downscaled(factor) if view.lens is not None else None
    flags = block_flags(view.flags, factor)
    radiance = block_radiance(view.radiance, view.valid, view.flags, factor)
    return View(radiance, block_mean(view.valid, factor), flags, lens, view.floor / factor, view.facts)
