"""Truth as a model: the material of every part or place, and the radiance of every triangle that emits. For bounds."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fipt.conventions import ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.model.parts import PartLabels, PartMaterials, centre_samples
from fipt.model.reflectance import Brdf
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.samples import FootprintSamples

_LAYERS = ("base_color", "roughness", "metallic", "emission")
_PLACES = 400_000
"""Places whose true material is kept, spread over all pixels."""


def true_pixels(data: Dataset, shards: Sequence[FootprintSamples]) -> dict[str, np.ndarray]:
    """``triangle`` (N,), ``place`` (N, 3) and truth of pixels whose centre hits the mesh, of all views together.

    Raises
    ------
    FiptError
        If a view has no truth, or lacks a layer.
    """
    found = list(_of_views(data, shards))
    return {name: np.concatenate([view[name] for view in found]) for name in (*_LAYERS, "triangle", "place")}


def _of_views(data: Dataset, shards: Sequence[FootprintSamples]) -> Iterator[Mapping[str, np.ndarray]]:
    for shard in shards:
        pixel, sample = centre_samples(shard)
        triangle, place = np.asarray(shard.triangle)[sample].astype(np.int64), np.asarray(shard.position)[sample]
        for index, view in enumerate(shard.views):
            truth = data.truth(view) or {}
            missing = [name for name in _LAYERS if name not in truth]
            if missing:
                raise FiptError(
                    f"the truth of {view} must have base colour, roughness, metallic and emission; it lacks "
                    f"{', '.join(missing)}",
                    "compare without bounds, which need the truth",
                )
            span = shard.pixels(index)
            own = (pixel >= span.start) & (pixel < span.stop)
            layers = {name: truth[name].reshape(span.stop - span.start, *truth[name].shape[2:]) for name in _LAYERS}
            yield {name: values[pixel[own] - span.start] for name, values in layers.items()} | {
                "triangle": triangle[own],
                "place": place[own],
            }


def mean_materials(labels: PartLabels, pixels: Mapping[str, np.ndarray]) -> PartMaterials:
    """Mean material of every part over the pixels that do not emit; that of all pixels where there is none."""
    reflects = pixels["emission"].max(axis=1) <= 0
    part = labels.of_triangle[pixels["triangle"][reflects]]
    base, roughness, metallic = (
        _means(pixels[name][reflects], part, labels.count) for name in ("base_color", "roughness", "metallic")
    )
    return PartMaterials(labels, Brdf(base, roughness.clip(ROUGHNESS_MIN, 1), metallic))


def true_materials(mesh: Mesh, pixels: Mapping[str, np.ndarray]) -> PartMaterials:
    """A model that has at every place the true material of the nearest pixel that does not emit."""
    reflects = np.flatnonzero(pixels["emission"].max(axis=1) <= 0)
    own = reflects[np.linspace(0, len(reflects) - 1, min(len(reflects), _PLACES)).astype(np.int64)]
    place, rows = pixels["place"][own].astype(np.float32), np.arange(1, len(own) + 1, dtype=np.int32)
    labels = PartLabels(np.zeros(len(mesh.triangles), np.int32), place, rows)
    values = (pixels[name][own].astype(np.float32) for name in ("base_color", "roughness", "metallic"))
    base, roughness, metallic = (np.concatenate([each[:1], each]) for each in values)  # row 0: nothing is known
    return PartMaterials(labels, Brdf(base, roughness.clip(ROUGHNESS_MIN, 1), metallic))


def true_emitters(mesh: Mesh, pixels: Mapping[str, np.ndarray]) -> Emitters:
    """Triangles most of whose pixels emit, with the mean of what they emit.

    A lamp has triangles that no pixel's centre shows: they emit what the others of its piece of the mesh do, if all
    of these that are shown emit.
    """
    triangle, emits = pixels["triangle"], pixels["emission"].max(axis=1) > 0
    count = len(mesh.triangles)
    shown = np.bincount(triangle, minlength=count)
    emitting = 2 * np.bincount(triangle, emits, count) > shown
    if not emitting.any():
        return Emitters.none()
    radiance = _means(pixels["emission"][emits], triangle[emits], count)
    piece = connected_parts(mesh)
    glows = np.bincount(piece, emitting) > 0
    glows &= np.bincount(piece, (shown > 0) & ~emitting) == 0
    hidden = glows[piece] & (shown == 0)
    radiance[hidden] = _means(radiance[emitting], piece[emitting], len(glows))[piece[hidden]]
    every = np.flatnonzero(emitting | hidden)
    patch = connected_parts(Mesh(mesh.vertices, mesh.triangles[every]))
    return Emitters.plain(mesh, every, radiance[every], patch)


def _means(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(count, ...) float32 mean of values (N, ...) in each group (N,); the mean of all where it is empty."""
    members = np.bincount(group, minlength=count)
    columns = values.reshape(len(values), -1).T
    sums = np.stack([np.bincount(group, column, count) for column in columns], axis=1)
    whole = columns.mean(axis=1) if len(values) else np.zeros(len(columns))
    means = np.where(members[:, None] > 0, sums / np.maximum(members, 1)[:, None], whole)
    return means.reshape(count, *values.shape[1:]).astype(np.float32)
