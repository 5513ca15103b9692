"""The light mixer's section of the page: views with each emitter alone, which the page adds up as the reader likes."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.formats.manifests import read_manifest
from fipt.scene.dataset import read_layers
from fipt.scene.emitters import default_name
from fipt.stages.report import images

log = logging.getLogger(__name__)

_WIDTH = 400
"""Largest width of the mixer's images, pixels: they are numbers of 16 bits, and there are many."""


@dataclass(frozen=True)
class LightPart:
    """What emits in one layer of the images.

    Attributes
    ----------
    key
        Layer: ``emitter-N``, ``rest`` or ``outside``.
    label
        For people.
    emitters
        Names in emitters.json.
    radiance
        (3,) of an emitter that can be given another colour; None for the rest and the outside, which have several, and
        for an emitter without any light in some channel.
    color
        ``#rrggbb`` of that radiance.
    """

    key: str
    label: str
    emitters: Sequence[str]
    radiance: Sequence[float] | None
    color: str | None


@dataclass(frozen=True)
class MixedView:
    """A view: its name, size in pixels, and its layers (see `encoded`)."""

    name: str
    width: int
    height: int
    data: str


@dataclass(frozen=True)
class Mixer:
    """Parts of the light, in the order of the views' layers, and the views."""

    parts: Sequence[LightPart]
    views: Sequence[MixedView]


def read_mixer(
    results: Path,
    emitters: Sequence[Mapping[str, Any]] | None,
    exposure: float,
    shards: Sequence[str] | None = None,
) -> Mixer | None:
    """Read the views of olat/ that the stage's manifests name; None where there are none.

    Parameters
    ----------
    emitters
        Entries of emitters.json, most powerful first.
    exposure
        Factor on radiance, the page's.
    shards
        Those whose views are shown; None: all that were rendered.

    None as well, with a warning, where they know other emitters than emitters.json: the mixer was switched off since.

    Raises
    ------
    FiptError
        If a file is missing or damaged.
    """
    manifests = sorted(results.glob("olat.*.manifest.json"))
    if shards is not None:
        named = {f"olat.{shard}.manifest.json" for shard in shards}
        manifests = [path for path in manifests if path.name in named]
    files = sorted(results / name for path in manifests for name in read_manifest(path, "olat")["files"])
    if not files:
        return None
    listed = list(emitters or ())
    alone = {default_name(int(entry["index"])): entry for entry in listed}
    order = [*alone, "rest", "outside"]
    views: list[MixedView] = []
    keys: list[str] = []
    for path in files:
        layers = read_layers(path)
        own = sorted(layers, key=lambda key: order.index(key) if key in order else len(order))
        if not set(own) <= set(order) or own != (keys or own):
            log.warning("%s shows other lamps than there are; without `fipt olat` the page has no mixer", path)
            return None
        keys = own
        stack = np.stack([_scaled(layers[key] * np.float32(exposure)) for key in own])
        height, width = stack.shape[1:3]
        views.append(MixedView(path.stem, width, height, encoded(stack)))
    rest = [entry["name"] for key, entry in alone.items() if key not in keys]
    return Mixer([_part(key, alone.get(key), rest) for key in keys], views)


def _part(key: str, emitter: Mapping[str, Any] | None, rest: Sequence[str]) -> LightPart:
    if key == "outside":
        return LightPart(key, "Light from outside", [], None, None)
    if emitter is None:
        return LightPart(key, f"The other {len(rest)} lamps", rest, None, None)
    radiance = emitter["radiance"] if min(emitter["radiance"]) > 0 else None
    return LightPart(key, emitter["name"], [emitter["name"]], radiance, emitter["color"])


def _scaled(image: np.ndarray) -> np.ndarray:
    """(H, W, 3) image, averaged down by area to the mixer's width where it is wider."""
    from PIL import Image

    height, width = image.shape[:2]
    if width <= _WIDTH:
        return image
    size = (_WIDTH, max(1, round(height * _WIDTH / width)))
    planes = [Image.fromarray(np.ascontiguousarray(image[..., c])) for c in range(3)]
    return np.stack([np.asarray(plane.resize(size, Image.Resampling.BOX)) for plane in planes], axis=-1)


def encoded(layers: np.ndarray) -> str:
    """Return (L, H, W, 3) values as half floats, L x 3 planes one after the other, packed for the page.

    The planes' low bytes come before all high bytes, which compress better when they are together.
    """
    largest = float(np.finfo(np.float16).max)
    planes = np.clip(np.nan_to_num(layers), 0, largest).transpose(0, 3, 1, 2).astype("<f2")
    return images.packed(planes.reshape(-1, 1).view(np.uint8).T.tobytes())
