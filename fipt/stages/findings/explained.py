"""Training pixels, and what the fit says of them: kd Ld + ks Ls0 + Ls1 under the shading of the last round."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fipt.conventions import SUB_POSITIONS
from fipt.model.fitted import FittedScene
from fipt.model.reflectance import brightest_reflection, line_in_base_color
from fipt.render.surface import emitter_set
from fipt.scene.dataset import Dataset
from fipt.scene.observed import ObservedShard, fully_weighted


@dataclass(frozen=True)
class ExplainedPixels:
    """N pixels of the training views, spread evenly over each.

    What belongs to a place is that of the piece that fills most of the pixel.

    Attributes
    ----------
    view
        (N,) int64 number of the view in ``views``.
    row, column
        (N,) int64 in the view.
    photo, predicted
        (N, 3) radiance: of the photograph, and of the fit, emitters included.
    diffuse
        (N, 3) Ld: radiance of a white matte surface there.
    brightest
        (N,) the most that a reflection could show, mean over RGB.
    position, normal, base_color
        (N, 3) of the piece.
    roughness, metallic, footprint
        (N,) of the piece; metres.
    share
        (N,) share of the pixel that the piece fills.
    mixed
        (N,) bool: the pixel shows more than one piece.
    segment, triangle
        (N,) int64; segment 0 where it is not known.
    emits
        (N,) bool: some emitter is in the pixel.
    use
        (N,) bool: valid, covered by the mesh, not clipped.
    clipped
        (N,) bool: valid and covered by the mesh, but the photograph is only a lower bound.
    """

    views: tuple[str, ...]
    view: np.ndarray
    row: np.ndarray
    column: np.ndarray
    photo: np.ndarray
    predicted: np.ndarray
    diffuse: np.ndarray
    brightest: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    footprint: np.ndarray
    share: np.ndarray
    mixed: np.ndarray
    segment: np.ndarray
    triangle: np.ndarray
    emits: np.ndarray
    use: np.ndarray
    clipped: np.ndarray

    def __len__(self) -> int:
        return len(self.view)

    def brighter(self, times: float) -> np.ndarray:
        """(N,) bool: one piece that does not emit, and more than ``times`` the brightest reflection.

        A clipped pixel counts, too: where a lower bound is above, so is the truth.
        """
        one = (self.use | self.clipped) & ~self.emits & ~self.mixed
        return one & (self.photo.mean(axis=1) > times * np.maximum(self.brightest, 1e-9))

    def spacing(self, own: np.ndarray) -> float:
        """Width of a typical pixel of ``own`` (N,) bool, or how far such pixels lie from each other, if more; metres.

        Of large photographs only every n-th pixel is compared.
        """
        rows = np.flatnonzero(own)
        if len(rows) < 2:
            return 0.0
        nearest = cKDTree(self.position[rows]).query(self.position[rows], k=2)[0][:, 1]
        return float(max(np.median(self.footprint[rows]), np.median(nearest)))


_COVERED = 0.99
"""Share of a pixel that the mesh must fill."""


def explained_pixels(data: Dataset, shards: Sequence[ObservedShard], fitted: FittedScene, most: int) -> ExplainedPixels:
    """Compare about ``most`` pixels of all training views with the fit."""
    views = [view for shard in shards for view in shard.samples.views]
    kind = data.segment_kind("auto")
    total = sum(int(shard.samples.first_pixels[-1]) for shard in shards)
    stride = int(np.ceil(np.sqrt(total / most)))
    parts, number = [], 0
    for shard in shards:
        for index in range(len(shard.samples.views)):
            ids = None if kind is None else data.segments(views[number], kind).reshape(-1)
            own = pixels_of_view(shard, index, grid(shard.samples.shapes[index], stride), fitted, ids)
            parts.append(own | {"view": np.full(len(own["row"]), number)})
            number += 1
    return ExplainedPixels(tuple(views), **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def grid(shape: tuple[int, int], stride: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (N,) of an evenly strided grid of pixels."""
    rows, columns = np.mgrid[stride // 2 : shape[0] : stride, stride // 2 : shape[1] : stride].reshape(2, -1)
    return rows, columns


def pixels_of_view(
    shard: ObservedShard,
    index: int,
    place: tuple[np.ndarray, np.ndarray],
    fitted: FittedScene,
    ids: np.ndarray | None = None,
    queries: int = 2,
) -> dict[str, np.ndarray]:
    """Fields of `ExplainedPixels` for pixels of view number ``index`` of a shard that show the mesh.

    Parameters
    ----------
    place
        Rows and columns (N,).
    ids
        (H W,) segment ids of the view; None: there are none.
    queries
        Points of each sample at which the model is asked.
    """
    samples = shard.samples
    rows, columns = place
    local = rows * samples.shapes[index][1] + columns
    pixel = samples.pixels(index).start + local
    first, last = np.asarray(samples.offsets[pixel]), np.asarray(samples.offsets[pixel + 1])
    seen = last > first
    rows, columns, local, pixel, first, last = (x[seen] for x in (rows, columns, local, pixel, first, last))
    count = last - first
    owner, sample = samples.samples_of(pixel)
    weight = np.asarray(samples.weight[sample])
    covered = np.bincount(owner, weight, len(pixel))
    light = _light(shard, fitted, sample, queries)
    mean = {name: _pooled(values, owner, weight / covered[owner]) for name, values in light.items()}
    order = np.lexsort((-weight, owner))
    main = sample[order][np.cumsum(count) - count]
    chief = order[np.cumsum(count) - count]
    whole = np.zeros(len(pixel)) if ids is None else np.where(np.asarray(samples.center[pixel]) > 0, ids[local], 0)
    full = fully_weighted(shard.weight[samples.pixels(index)])[local] & (covered > _COVERED)
    clipped = np.asarray(shard.clipped[pixel])
    return {
        "row": rows,
        "column": columns,
        "photo": np.asarray(shard.radiance[pixel]),
        "predicted": mean["predicted"],
        "diffuse": mean["diffuse"],
        "brightest": mean["brightest"],
        "position": np.asarray(samples.position[main]),
        "normal": np.asarray(samples.normal[main]),
        "base_color": light["base_color"][chief],
        "roughness": light["roughness"][chief],
        "metallic": light["metallic"][chief],
        "footprint": np.asarray(samples.footprint[main]),
        "share": weight[chief],
        "mixed": count > 1,
        "segment": whole.astype(np.int64),
        "triangle": np.asarray(samples.triangle[main]).astype(np.int64),
        "emits": mean["emits"] > 0,
        "use": full & ~clipped,
        "clipped": full & clipped,
    }


def _light(shard: ObservedShard, fitted: FittedScene, sample: np.ndarray, queries: int) -> dict[str, np.ndarray]:
    """What samples (H,) send to the viewer, and their materials, averaged over points of each."""
    samples = shard.samples
    picks = np.arange(queries) * SUB_POSITIONS // queries
    spread = np.asarray(samples.sub[sample])[:, picks].astype(np.float32) if queries > 1 else np.float32(0)
    points = np.asarray(samples.position[sample])[:, None] + spread
    surface = (np.repeat(np.asarray(each[sample]), queries, axis=0) for each in (samples.normal, samples.footprint))
    brdf = fitted.reflectance(points.reshape(-1, 3), *surface)
    base = brdf.base_color.reshape(-1, queries, 3).mean(1)
    roughness = brdf.roughness.reshape(-1, queries).mean(1)
    metallic = brdf.metallic.reshape(-1, queries).mean(1)
    shading = np.asarray(shard.shading[sample], np.float32)
    offset, slope = line_in_base_color(shading, roughness, metallic)
    triangle, front = np.asarray(samples.triangle[sample]), fitted.mesh.front
    emitted = emitter_set(fitted.emitters).emitted(triangle, front(triangle, np.asarray(samples.normal[sample])))
    emits = emitted.max(axis=1) > 0
    return {
        "predicted": np.where(emits[:, None], emitted, offset + slope * base),
        "diffuse": shading[:, 0],
        "brightest": brightest_reflection(shading),
        "emits": emits.astype(np.float32),
        "base_color": base,
        "roughness": roughness,
        "metallic": metallic,
    }


def _pooled(values: np.ndarray, owner: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted sums (N, ...) float32 of the samples of each pixel."""
    count = int(owner[-1]) + 1 if len(owner) else 0
    if values.ndim == 1:
        return np.bincount(owner, weight * values, count).astype(np.float32)
    return np.stack([np.bincount(owner, weight * column, count) for column in values.T], axis=1).astype(np.float32)
