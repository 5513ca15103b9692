"""JPEG and PNG brackets: the camera's response by Debevec and Malik's method (OpenCV), and the merge through it.

The light of such images went through a camera's colour processing: what comes out is a likeness, not a measurement,
and is marked ``ldr`` wherever it goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.formats.images import decoded
from fipt.stages.capture.brackets import Bracket, Capture
from fipt.stages.capture.exposures import exposure

LOWEST, HIGHEST = 4, 251
"""8-bit values outside count as black and as clipped."""

_SAMPLES, _SMOOTHNESS = 200, 30.0

_BOUND, _NOTHING = 1e-4, 1e-8
"""Weights of black in the longest exposure and of clipped in the shortest, which bound the light; and elsewhere."""


def read_ldr(path: Path) -> np.ndarray:
    """Read a JPEG or PNG as (H, W, 3) uint8 RGB in the sensor's frame (EXIF orientation is not applied)."""
    image = decoded(existing_file(path, "a photograph"), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise FiptError(f"{path} is not a readable JPEG or PNG", "copy it from the card again")
    return image


def response(capture: Capture, snap: bool = True) -> np.ndarray:
    """(256, 3) float64 log exposure of each 8-bit value, 0 in its middle; from the first brackets of a capture.

    ``snap`` as in `fipt.stages.capture.exposures.exposure`.

    Raises
    ------
    FiptError
        If no bracket has two exposures or more.
    """
    curves = []
    for bracket in capture.of_response:
        images = [read_ldr(shot.path) for shot in bracket.shots]
        check_order(bracket, images)
        times = np.array([exposure(shot, snap) for shot in bracket.shots], np.float32)
        method = cv2.createCalibrateDebevec(_SAMPLES, _SMOOTHNESS, random=False)
        curve = np.log(np.maximum(method.process(images, times).reshape(256, 3), 1e-9))
        if not np.isfinite(curve).all():
            raise FiptError(
                f"view {bracket.view}: its exposures must tell the response of the camera; they hold too few values",
                "remove the view, or photograph it again",
            )
        curves.append(curve - curve[128])
    if not curves:
        raise FiptError(
            f"the response of JPEG and PNG needs a bracket of two exposures; {capture.folder} has none",
            "photograph brackets, or RAW",
        )
    return np.mean(curves, axis=0).astype(np.float64)


def check_order(bracket: Bracket, images: Sequence[np.ndarray]) -> None:
    """Check that the images of a bracket, longest first, have one size and that each is darker than the one before.

    Raises
    ------
    FiptError
        If not: the times that the files state are not theirs, or nothing can be seen.
    """
    names = [shot.path.name for shot in bracket.shots]
    means = [float(image.mean()) for image in images]
    for number in range(1, len(images)):
        size, first = images[number].shape, images[0].shape
        if size != first:
            raise FiptError(
                f"view {bracket.view}: {names[number]} must be {first[1]}x{first[0]} like {names[0]}; it is "
                f"{size[1]}x{size[0]}",
                "a bracket must be of one camera and one size",
            )
        before = means[number - 1]
        if means[number] >= before + (0 if LOWEST < before < HIGHEST else 1):  # in the dark, noise decides
            raise FiptError(
                f"view {bracket.view}: {names[number]} must be darker than {names[number - 1]}, exposed for longer; "
                f"their means are {means[number]:.0f} and {before:.0f} of 255",
                "state the true times in captures.tsv, or photograph the view again",
            )


def merge_ldr(
    images: Sequence[np.ndarray], exposures: Sequence[float], curve: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Merge 8-bit images, longest first, through their response with hat weights.

    Black counts in the longest and clipped in the shortest, there little; elsewhere they count where all else fails.

    Returns
    -------
    radiance
        (H, W, 3) float32.
    saturated, noisy
        (H, W) bool: clipped in the shortest, black in the longest.
    clipped
        Share of clipped pixels of each exposure.
    """
    values = np.arange(256)
    black, full = values < LOWEST, values > HIGHEST
    hat = np.minimum(values, 255 - values).astype(np.float32) + np.float32(0.01)
    hats = [np.where(black | full, np.float32(_NOTHING), hat) for _ in images]
    hats[0][black] = hats[-1][full] = _BOUND
    light = np.exp(curve).astype(np.float32)
    total = np.zeros(images[0].shape, np.float32)
    weights = np.zeros_like(total)
    clipped = []
    for image, e, weight in zip(images, exposures, hats, strict=True):
        w = weight[image]
        total += w * np.stack([light[image[..., c], c] for c in range(3)], axis=-1) / np.float32(e)
        weights += w
        clipped.append(float((image > HIGHEST).any(axis=-1).mean()))
    saturated = np.asarray((images[-1] > HIGHEST).any(axis=-1))
    noisy = np.asarray((images[0] < LOWEST).all(axis=-1))
    return total / weights, saturated, noisy, clipped
