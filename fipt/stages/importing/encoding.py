"""What images of a source look like that are no radiance: values of 8 bits, light that is cut off, one image twice."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from fipt.conventions import FLAG_SATURATED
from fipt.stages.importing import defects

_LEVELS = 256
"""Values of 8 bits."""
_FEWEST_LEVELS = 64
"""Values that a channel must have at least to be called an image of 8 bits: fewer have images drawn by hand."""
_PIXELS = 4096
"""Pixels that must have no more than 256 values: noise, or shading, gives as many pixels nearly as many values."""
_EVEN = 1e-3
"""Share of a step by which values may lie off even steps: float32 and half rounding are below."""
_PLATEAU = 1e-4
"""Share of the pixels that must lie at the largest value: a lamp of a few pixels in each view."""
_FEWEST_ALIKE = 256
"""Pixels from which two views that have the same are no chance."""
_KINDS = 4
"""Different colours that pixels at one channel's largest value must have: a lamp of one radiance has one colour."""


class EncodingCheck:
    """Collects what tells that images are no radiance, view by view."""

    def __init__(self) -> None:
        self._values = np.zeros(0, np.float32)
        self._pixels = 0
        self._counted = 0
        self._most = np.zeros(3, np.float32)
        self._at_most: list[dict[str, np.ndarray]] = [{}, {}, {}]
        self._views: dict[bytes, list[str]] = {}
        self._black: list[str] = []

    def add(self, view: str, channels: Mapping[str, np.ndarray], valid: np.ndarray) -> None:
        """Look at a view: its channels ('' = RGB as the source has it) and its (H, W) weights."""
        flags = channels.get("flags.Y", np.zeros(valid.shape)).astype(np.uint32)
        known = channels[""][(valid > 0) & (flags & FLAG_SATURATED == 0)]
        known = known[np.isfinite(known).all(axis=1)]
        self._pixels += len(known)
        if known.any() and len(known) >= _FEWEST_ALIKE:
            self._views.setdefault(hashlib.sha256(channels[""].tobytes()).digest(), []).append(view)
        if not known.any():
            self._black.append(view)
        if len(self._values) <= _LEVELS:
            self._values = np.union1d(self._values, known[:: max(len(known) // 20_000, 1), 1])
            self._counted += len(known)
        if not len(known):
            return
        for c, most in enumerate(known.max(axis=0)):
            if most > self._most[c]:
                self._most[c], self._at_most[c] = most, {}
            if most == self._most[c]:
                self._at_most[c][view] = known[known[:, c] == most]

    def facts(self) -> dict[str, Any]:
        """What was found, as plain JSON types; nothing where images look like radiance."""
        same = [views for views in self._views.values() if len(views) > 1]
        alike = ({"same": same} if same else {}) | ({"black": self._black} if self._black else {})
        return self._eight_bits() | self._cut() | alike

    def _eight_bits(self) -> dict[str, Any]:
        values = self._values[self._values > 0]
        if self._counted < _PIXELS or not _FEWEST_LEVELS <= len(values) <= _LEVELS:
            return {}
        place = values / values[-1] * (_LEVELS - 1)  # even steps, if the brightest value is white
        even = np.abs(place - np.rint(place)).max() < 0.5 * _EVEN * _LEVELS
        return {"levels": {"count": len(values), "even": bool(even)}}

    def _cut(self) -> dict[str, Any]:
        worst: dict[str, np.ndarray] = {}
        for most, found in zip(self._most, self._at_most, strict=True):
            together = np.concatenate(list(found.values())) if found else np.zeros((0, 3), np.float32)
            # what is stored between 0 and 1 ends there; images drawn by hand have few values
            white = bool(most == 1.0 and (together == 1.0).all()) and len(self._values) >= _FEWEST_LEVELS
            if len(together) < max(_PLATEAU * self._pixels, _KINDS) or not most > 0:
                continue
            if (len(np.unique(together, axis=0)) >= _KINDS or white) and len(together) > sum(map(len, worst.values())):
                worst = found
        if not worst:
            return {}
        views = sorted(worst, key=lambda view: -len(worst[view]))
        count = sum(map(len, worst.values()))
        radiance = float(max(values.max() for values in worst.values()))
        return {"cut": {"radiance": radiance, "share": count / self._pixels, "views": views}}


def sentences(facts: Mapping[str, Any], views: int = 0) -> list[str]:
    """What a person should know of `EncodingCheck.facts`, and of the ``defects`` of so many views."""
    said = []
    if levels := facts.get("levels"):
        how = "in even steps: it is likely still encoded for a display" if levels["even"] else "decoded from 8 bits"
        said.append(
            f"all images together have {levels['count']} values only, {how}; light must be linear and finer than 8 "
            "bits (HDR)"
        )
    if cut := facts.get("cut"):
        said.append(
            f"{cut['share']:.2%} of the pixels have one largest value, {cut['radiance']:.4g}, in different colours, "
            f"mostly in {', '.join(cut['views'][:3])}: light is cut off there without a flag; set flags.Y to 1 in such "
            "pixels (lower bounds), or export without clipping"
        )
    said += [
        f"views {', '.join(views[:3])}{f' and {len(views) - 3} more' if len(views) > 3 else ''} have one and the same "
        "image: correct the list of views, or leave all but one out"
        for views in facts.get("same", [])
    ]
    said += defects.sentences(facts.get("defects", {}), views)
    if black := facts.get("black"):
        said.append(f"no pixel of {', '.join(black[:3])} shows any light ({len(black)} views): leave them out")
    return said
