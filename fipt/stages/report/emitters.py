"""The emitters of the page: names, figures and thumbnails."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.scene.emitters import default_name
from fipt.stages.report import images
from fipt.stages.report.files import read_json, round_folders
from fipt.stages.report.images import EmbeddedImage


def read_emitter_entries(results: Path) -> list[Mapping[str, Any]] | None:
    """Emitters with names and images, else those of the last round with an extraction, by power; None without any."""
    for path in (
        results / "emitters" / "emitters.json",
        *(f / "emitters.json" for f in reversed(round_folders(results))),
    ):
        content = read_json(path)
        if content is None:
            continue
        try:
            found = [_entry(entry, path.parent) for entry in content["emitters"]]
        except (KeyError, TypeError, ValueError) as error:
            raise FiptError(f"{path} is not a list of emitters ({error!r})", "run fipt emitters again") from error
        return sorted(found, key=lambda entry: -entry["power"])
    return None


def _entry(entry: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page shows of an emitter."""
    return {
        "index": int(entry["index"]),
        "name": _name(entry),
        "triangles": int(entry["triangles"]),
        "area": float(entry["area"]),
        "radiance": [float(value) for value in entry["radiance"]],
        "center": [float(value) for value in entry["center"]],
        "color": images.swatch(entry["radiance"]),
        "power": float(np.mean(entry["power"])),
        "views": int(entry["views"]),
        "confidence": float(entry["confidence"]),
        "lower_bound": bool(entry.get("lower_bound")),
        "guessed": bool(entry.get("guessed")),
        "thumbnail": _thumbnail(entry, folder),
    }


def _name(entry: Mapping[str, Any]) -> str:
    """The emitter's name; extractions of older versions wrote none."""
    return str(entry.get("name") or default_name(int(entry["index"])))


def _thumbnail(entry: Mapping[str, Any], folder: Path) -> EmbeddedImage | None:
    """EmbeddedImage of a lamp; None where no view shows it, or there are none yet."""
    from PIL import Image

    if not entry.get("thumbnail"):
        return None
    with Image.open(existing_file(folder / entry["thumbnail"], "the image of an emitter")) as image:
        pixels = np.asarray(image.convert("RGB"))
    return EmbeddedImage("emitter", _name(entry), *images.embedded(pixels, pixels.shape[1]))
