"""Layers and pictures of another program that hold nothing: zero everywhere, or one value where that cannot be."""

from collections.abc import Iterator, Mapping

import numpy as np

from fipt.errors import FiptError

_CONSTANT = ("kd", "reflectance", "image")
"""What has one value in all pixels of no room; one roughness, or no emission, may be what a method assumes."""
_LISTED = 5

Views = Mapping[str, Mapping[str, np.ndarray]]
"""View -> layer -> its pixels; a picture is the layer without a name."""


def check_not_blank(found: Mapping[str, Views]) -> list[str]:
    """Return warnings about layers that are blank, with their views.

    Parameters
    ----------
    found
        ``materials``, ``render``, ... -> its views; the layer ``hit`` is ours, and not looked at.

    Raises
    ------
    FiptError
        If everything is zero.
    """
    blank: dict[tuple[str, str, str], list[str]] = {}
    views: dict[tuple[str, str], int] = {}
    empty = True
    for folder, view, layer, values in _layers(found):
        views[folder, layer] = views.get((folder, layer), 0) + 1
        low, high = float(values.min()), float(values.max())
        empty &= low == high == 0
        if low == high == 0:
            blank.setdefault((folder, layer, "0"), []).append(view)
        elif layer in _CONSTANT and np.array_equal(values.min(axis=(0, 1)), values.max(axis=(0, 1))):
            blank.setdefault((folder, layer, "one value"), []).append(view)
    if empty and views:
        raise FiptError("all that was imported is 0 in every pixel of every view", "export the results again")
    return [
        f"{folder}: {layer} is {what} in all pixels of {_listed(own, views[folder, layer])}"
        for (folder, layer, what), own in blank.items()
        if layer != "emission" or len(own) == views[folder, layer]  # many views show no lamp
    ]


def _layers(found: Mapping[str, Views]) -> Iterator[tuple[str, str, str, np.ndarray]]:
    for folder, views in found.items():
        for view, layers in views.items():
            for name, values in layers.items():
                layer = name.removesuffix(".Y") or "image"
                if layer != "hit":
                    yield folder, view, layer, values


def _listed(views: list[str], count: int) -> str:
    if len(views) == count > _LISTED:
        return f"all {count} views"
    more = len(views) - _LISTED
    return ", ".join(views[:_LISTED]) + (f" and {more} more views" if more > 0 else "")
