"""Layers and pictures of views as others estimated them, perhaps scaled to the truth."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.formats.exr import read_rgb
from fipt.model.parts import centre_samples
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples
from fipt.stages.import_results.files import DEPTH, OtherResults
from fipt.stages.import_results.layouts import image_of, layers_of, scaled_to
from fipt.stages.import_results.settings import ImportResultsSettings

log = logging.getLogger(__name__)

_SCALED = ("kd", "reflectance")
"""Layers that are only known up to a factor where images are scaled."""
_DEPTH_OFF = 0.1
"""Of depth, as a logarithm: larger differences have no other cause than another view or another mesh."""


def material_layers(
    data: Dataset, shards: Sequence[FootprintSamples], found: OtherResults, settings: ImportResultsSettings
) -> dict[str, dict[str, np.ndarray]]:
    """View -> its layers with ``hit``, as `fipt.scene.dataset.read_layers` reads them; empty where none are given."""
    if not found.materials:
        return {}
    place = {view: (shard, index) for shard in shards for index, view in enumerate(shard.views)}
    result = {}
    for view in (view for view in data.views(settings.views) if not settings.only or view in settings.only):
        camera = data.camera(view)
        layers = layers_of(found, view, (camera.height, camera.width))
        shard, index = place[view]
        if DEPTH in layers:
            _compare_depth(layers.pop(DEPTH).ravel(), shard, index, camera)
        truth = data.truth(view) or {}
        for name in _SCALED if settings.scaled else ():
            if name in layers and name in truth:
                layers[name] = scaled_to(layers[name], truth[name])
        hit = np.asarray(shard.center[shard.pixels(index)]).astype(np.float32)
        result[view] = {name if v.ndim == 3 else f"{name}.Y": v for name, v in layers.items()} | {
            "hit.Y": hit.reshape(camera.height, camera.width)
        }
    return result


def _compare_depth(given: np.ndarray, shard: FootprintSamples, index: int, camera: Camera) -> None:
    """Warn where the depth (P,) of a view, in any unit, is not that of the mesh: it was perhaps another view."""
    pixel, first = centre_samples(shard)
    span = shard.pixels(index)
    own = (pixel >= span.start) & (pixel < span.stop)
    _, depth = camera.project(np.asarray(shard.position)[first[own]])
    given = given[pixel[own] - span.start]
    both = (given > 0) & (depth > 0)
    ratio = np.log(given[both] / depth[both])
    off = np.abs(ratio - np.median(ratio)) if len(ratio) else np.zeros(0)
    if len(off) == 0 or np.median(off) > _DEPTH_OFF:
        log.warning("%s: the given depth is not that of the mesh there; is it of this view?", camera.name)


def shown_images(
    data: Dataset, found: OtherResults, kind: str, truth: Path | None, scaled: bool
) -> dict[str, dict[str, np.ndarray]]:
    """View -> its image (H, W, 3) under ``""``; empty where none are given.

    Parameters
    ----------
    kind
        ``viewsynthesis`` or ``relight``.
    truth
        Folder of the true images, to which they are ``scaled``; None: to the photographs, where these say something.
    """
    result = {}
    for view, path in found.images.get(kind, {}).items():
        camera = data.camera(view)
        image = image_of(path, (camera.height, camera.width))
        if scaled and truth is None:
            photo, valid = data.image(view)
            image = scaled_to(image, photo, (valid > 0) & ~data.clipped(view))
        elif scaled and truth is not None and (true := truth / f"{view}.exr").is_file():
            image = scaled_to(image, read_rgb(true))
        result[view] = {"": image}
    return result
