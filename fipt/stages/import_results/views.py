"""Layers and pictures of views as others estimated them, perhaps scaled to the truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.formats.exr import read_rgb
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples
from fipt.stages.import_results.files import OtherResults
from fipt.stages.import_results.layouts import image_of, layers_of, scaled_to
from fipt.stages.import_results.settings import ImportResultsSettings

_SCALED = ("kd", "reflectance")
"""Layers that are only known up to a factor where images are scaled."""


def material_layers(
    data: Dataset, shards: Sequence[FootprintSamples], found: OtherResults, settings: ImportResultsSettings
) -> dict[str, dict[str, np.ndarray]]:
    """View -> its layers with ``hit``, as `fipt.scene.dataset.read_layers` reads them; empty where none are given."""
    if not found.materials:
        return {}
    on_mesh = _on_mesh(shards)
    result = {}
    for number, view in enumerate(data.views(settings.views)):
        camera = data.camera(view)
        layers = layers_of(found, number, (camera.height, camera.width))
        truth = data.truth(view) or {}
        for name in _SCALED if settings.scaled else ():
            if name in layers and name in truth:
                layers[name] = scaled_to(layers[name], truth[name])
        result[view] = {name if v.ndim == 3 else f"{name}.Y": v for name, v in layers.items()} | {
            "hit.Y": on_mesh[view].reshape(camera.height, camera.width)
        }
    return result


def _on_mesh(shards: Sequence[FootprintSamples]) -> dict[str, np.ndarray]:
    """View -> (P,) float32, 1 where the pixel's centre hits the mesh."""
    return {
        view: np.asarray(shard.center[shard.pixels(index)]).astype(np.float32)
        for shard in shards
        for index, view in enumerate(shard.views)
    }


def shown_images(
    data: Dataset, found: OtherResults, kind: str, truth: Path, scaled: bool
) -> dict[str, dict[str, np.ndarray]]:
    """View -> its image (H, W, 3) under ``""``; empty where none are given.

    Parameters
    ----------
    kind
        ``viewsynthesis`` or ``relight``.
    truth
        Folder of the true images, to which they are ``scaled``.
    """
    result = {}
    for view, path in zip(data.views("val"), found.images.get(kind, ()), strict=False):
        camera = data.camera(view)
        image = image_of(path, (camera.height, camera.width))
        true = truth / f"{view}.exr"
        result[view] = {"": scaled_to(image, read_rgb(true)) if scaled and true.is_file() else image}
    return result
