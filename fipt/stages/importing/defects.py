"""What pixels of a source look like that show no room: borders, defects of a sensor, channels without light."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

_PIXELS = 4096
"""Pixels that a view must have: of smaller ones chance tells, or a hand."""
_VIEWS = 4
"""Views in which a pixel must have one and the same value."""
_ALONE = 1000.0
"""Times that a pixel is as bright as the brightest around it: no lamp ends so suddenly."""
_COARSE = range(3, 65)
"""Values of the darker half of a view that are too few."""
_AROUND = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)
_LISTED = 5


class DefectCheck:
    """Collects what is wrong with pixels, view by view."""

    def __init__(self) -> None:
        self._first: np.ndarray | None = None
        self._stuck = np.zeros((0, 0), bool)
        self._views = 0
        self._found: dict[str, dict[str, float]] = {}

    def add(self, view: str, channels: Mapping[str, np.ndarray], valid: np.ndarray) -> None:
        """Look at a view: its channels ('' = RGB, ``alpha.Y``) and its (H, W) weights."""
        image, known = channels[""], valid > 0
        if known.sum() < _PIXELS or not np.isfinite(image[known]).all():
            return
        image = np.where(np.isfinite(image), image, 0)  # where it has no weight, it may be anything
        self._views += 1
        self._compare(image, known)
        pixels = image[known]
        dark = [letter for letter, values in zip(("red", "green", "blue"), pixels.T, strict=True) if not values.any()]
        said = {f"no {letter}": 1.0 for letter in dark if pixels.any()}
        said["grey"] = float((pixels == pixels[:, :1]).all())
        said["border"] = _border(image, known)
        said["alone"] = _alone(image, known)
        said["coarse"] = _few_values(pixels[:, 1])
        if "alpha.Y" in channels:
            said["alpha"] = float((channels["alpha.Y"][known] != 1).mean())
        for what, value in said.items():
            if value:
                self._found.setdefault(what, {})[view] = value

    def _compare(self, image: np.ndarray, known: np.ndarray) -> None:
        """Keep which pixels have had one value in all views."""
        if self._first is None:
            self._first, self._stuck = image.copy(), known.copy()
        elif self._first.shape == image.shape:
            self._stuck &= known & (image == self._first).all(axis=-1)
        else:
            self._stuck[:] = False

    def facts(self) -> dict[str, Any]:
        """What was found, as plain JSON types; nothing where pixels look sound."""
        stuck = int(self._stuck.sum())
        alike = self._views >= _VIEWS and 0 < stuck < self._stuck.size
        return self._found | ({"stuck": stuck} if alike else {})


def sentences(facts: Mapping[str, Any], views: int) -> list[str]:
    """What a person should know of `DefectCheck.facts` of so many views."""
    said = []
    if stuck := facts.get("stuck"):
        said.append(
            f"{stuck} pixels have one and the same value in all views: a border, a watermark, or defects of the "
            "sensor; set valid.Y to 0 there"
        )
    for what, text in _TEXTS.items():
        if own := facts.get(what):
            more = len(own) - _LISTED
            some = f"{', '.join(list(own)[:_LISTED])}{f' and {more} more' if more > 0 else ''}"
            said.append(f"{'all views' if len(own) == views else some}: {text.format(max(own.values()))}")
    return said


_TEXTS = {
    "no red": "no red at all; a channel is missing",
    "no green": "no green at all; a channel is missing",
    "no blue": "no blue at all; a channel is missing",
    "grey": "no colours; red, green and blue are the same in every pixel",
    "border": "rows or columns of one value at an edge, up to {:.0f}: a border. Set valid.Y to 0 there, or crop",
    "alone": "pixels that are 1000 times as bright as all around them, up to {:.0f}: hot pixels or fireflies. "
    "Set valid.Y to 0 there",
    "coarse": "at most {:.0f} values in their darker half; export 32-bit floats, or brighter 16-bit ones",
    "alpha": "an alpha that is not 1, in up to {:.1%} of the pixels: it is not looked at. Where colours are "
    "multiplied by it they are too dark: set valid.Y to 0 there",
}


def _border(image: np.ndarray, known: np.ndarray) -> float:
    """Rows or columns of one value at the edge where there are most; 0 of an image that is all of one value."""
    most = 0
    for rows, marks in ((image, known), (image.swapaxes(0, 1), known.T)):
        for lines, weights in ((rows, marks), (rows[::-1], marks[::-1])):
            plain = ((lines == lines[:1, :1]).all(axis=-1) & weights).all(axis=1)
            count = len(plain) if plain.all() else int(np.argmin(plain))
            most = max(most, count if count < len(plain) else 0)
    return float(most)


def _alone(image: np.ndarray, known: np.ndarray) -> float:
    """How many pixels are far brighter than all of their eight neighbours, which are not black."""
    light = np.where(known, image.max(axis=-1), 0.0)
    around = maximum_filter(light, footprint=_AROUND, mode="nearest")
    return float((light > _ALONE * np.where(around > 0, around, np.inf)).sum())


def _few_values(values: np.ndarray) -> float:
    """Number of values of the darker half (N,) where they are few whole multiples of the smallest; else 0."""
    dark = np.unique(values[(values <= np.median(values)) & (values > 0)])
    if len(dark) not in _COARSE or (values > 0).mean() < 0.75:
        return 0.0
    steps = dark / dark[0]
    return float(len(dark)) if np.abs(steps - np.rint(steps)).max() < 1e-3 else 0.0
