"""Photographs that are one image under two names: a file that was copied, or given at two exposures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from hashlib import blake2b

import numpy as np

from fipt.errors import FiptError
from fipt.stages.capture.brackets import Bracket, Finding

_REMEDY = "one is a copy of the other: remove it, or copy both from the card again"


def content(pixels: np.ndarray) -> str | None:
    """Short hash of an image; None where all its values are equal, as of a lamp that fills it: these may recur."""
    if pixels.size == 0 or pixels.min() == pixels.max():
        return None
    return blake2b(np.ascontiguousarray(pixels).data, digest_size=8).hexdigest()


def check_copies(bracket: Bracket, images: Iterable[np.ndarray]) -> dict[str, str | None]:
    """File -> hash of each image of a bracket, in the order of its shots.

    Raises
    ------
    FiptError
        If two are one image: no two exposures are.
    """
    owners: dict[str, str] = {}
    named: dict[str, str | None] = {}
    for shot, image in zip(bracket.shots, images, strict=True):
        name, found = shot.path.name, content(image)
        if found is not None and owners.setdefault(found, name) != name:
            raise FiptError(f"view {bracket.view}: {owners[found]} and {name} hold the same image", _REMEDY)
        named[name] = found
    return named


def copied_views(images: Mapping[str, Mapping[str, str | None]]) -> list[Finding]:
    """Findings of images that two views share.

    Parameters
    ----------
    images
        View -> its files -> their hashes, of `check_copies`.
    """
    owners: dict[str, tuple[str, str]] = {}
    shared: dict[tuple[str, str], tuple[str, str]] = {}
    for view, named in images.items():
        for name, found in named.items():
            if found is None:
                continue
            other, known = owners.setdefault(found, (view, name))
            if other != view:
                shared.setdefault((other, view), (known, name))
    return [
        Finding("copied", "warning", f"views {a} and {b}: {first} and {second} hold the same image", _REMEDY, (a, b))
        for (a, b), (first, second) in shared.items()
    ]
