"""The background stage: stated, given, or fitted to the pixels that see no surface."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from fipt.errors import FiptError
from fipt.formats.manifests import Stats
from fipt.scene.dataset import Dataset
from fipt.scene.environment import (
    NOTHING,
    EnvironmentMap,
    constant,
    in_unit,
    open_pixels,
    pixel_directions,
    read_map,
    solid_angles,
    texel_directions,
)
from fipt.scene.observed import before_shading
from fipt.scene.samples import FootprintSamples
from fipt.scene.surface_blocks import blocks_of
from fipt.stages.environment.settings import ConstantEnvironment, EnvironmentSettings, GivenEnvironment, NoEnvironment
from fipt.stages.environment.unseen import lit_from_outside, room_light, sphere_edges

_ENOUGH = 1e-3
"""Share of the training pixels that must see outside before mode auto believes that there is one."""
_ROWS = 32
"""Rows of the map of what the room tells: its light hardly changes within less than 6 degrees of the sky."""
_LEAST_BLOCKS = 30
"""Pieces of seen surface without which no light is told from a reflectance."""


def find_environment(
    dataset: Dataset,
    shards: list[FootprintSamples],
    settings: EnvironmentSettings,
    stats: Stats,
    cache: Callable[[], Mapping[str, np.ndarray]],
) -> EnvironmentMap:
    """Return the background that the settings ask for, in the unit of the dataset; they state that of the source.

    ``cache`` reads the radiance cache, where it is needed.

    Raises
    ------
    FiptError
        If the map of mode `given` is none, or a fit was asked for and no pixel sees outside.
    """
    nothing = replace(NOTHING, up=settings.up)
    if isinstance(settings, NoEnvironment):
        return nothing
    if isinstance(settings, GivenEnvironment):
        return in_unit(read_map(settings.file, settings.up, settings.rotation), dataset.radiance_scale)
    if isinstance(settings, ConstantEnvironment) and settings.radiance is not None:
        return in_unit(constant(settings.radiance, settings.up), dataset.radiance_scale)
    pixels, share = _observed(dataset, shards)
    stats["open_pixels"] = share
    if settings.mode == "auto" and share < _ENOUGH:
        return nothing
    if len(pixels[0]) == 0:
        raise FiptError(
            f"environment.mode {settings.mode} needs training pixels that see no surface; there is none "
            "(a pixel counts where it and the eight around it miss the mesh)",
            "use mode none or given, or constant with a stated radiance",
        )
    mean, seen = directional_mean(*pixels, settings.resolution, settings.up)
    angle = solid_angles(*seen.shape) * seen
    stats["seen_directions"] = float(angle.sum() / (4 * np.pi))
    if settings.mode == "constant":
        return constant((mean * angle[..., None]).sum(axis=(0, 1)) / angle.sum(), settings.up)
    found = EnvironmentMap("map", filled(mean, seen), settings.up)
    if settings.unseen == "smooth" or seen.all():
        return found
    rows = min(settings.resolution, _ROWS)
    coarse = (mean, seen) if rows == len(seen) else directional_mean(*pixels, rows, settings.up)
    of_room = _of_room_light(dataset, shards, cache(), *coarse, settings.up, stats)
    if of_room is None:
        return found
    if rows == len(seen):
        return of_room
    elsewhere = of_room.lookup(texel_directions(*seen.shape) @ of_room.map_from_world).reshape(mean.shape)
    return EnvironmentMap("map", np.where(seen[..., None], mean, elsewhere).astype(np.float32), settings.up)


def _of_room_light(
    dataset: Dataset,
    shards: list[FootprintSamples],
    cache: Mapping[str, np.ndarray],
    mean: np.ndarray,
    seen: np.ndarray,
    up: str,
    stats: Stats,
) -> EnvironmentMap | None:
    """The map with unseen directions as the light in the room tells; None where too little of the room is seen."""
    mesh = dataset.mesh()
    none = np.zeros(len(mesh.triangles), bool)
    blocks = blocks_of(before_shading(dataset, shards), mesh, none, cache)
    if len(blocks.radiance) < _LEAST_BLOCKS:
        return None
    smooth = EnvironmentMap("map", filled(mean, seen), up)
    light = room_light(blocks, mesh, cache, smooth)
    radiance, figures = lit_from_outside(mean, seen, smooth.radiance, blocks, light)
    stats.update(figures)
    return replace(smooth, radiance=radiance)


def directional_mean(
    directions: np.ndarray, radiance: np.ndarray, weight: np.ndarray, clipped: np.ndarray, rows: int, up: str = "y"
) -> tuple[np.ndarray, np.ndarray]:
    """Average pixels by direction, in the texels of a map of ``rows`` x 2 ``rows``.

    A bound below what others measure in its texel says nothing new and counts as they do; where there are only bounds,
    the radiance is at least the highest of them.

    Parameters
    ----------
    directions, radiance
        (N, 3) unit world directions and observed radiance.
    weight
        (N,) positive.
    clipped
        (N,) bool: the radiance is only a lower bound.

    Returns
    -------
    mean
        (rows, 2 rows, 3) mean radiance, 0 where nothing is seen.
    seen
        (rows, 2 rows) bool: whether a pixel looks along the texel.
    """
    shape = (rows, 2 * rows)
    place = EnvironmentMap("map", np.zeros((*shape, 3), np.float32), up).texels(directions)
    row, column = np.floor(place).astype(np.int64).T
    texel = np.minimum(row, rows - 1) * 2 * rows + column % (2 * rows)
    exact, highest = ~clipped, np.zeros((2 * rows**2, 3))
    np.maximum.at(highest, texel[clipped], radiance[clipped])
    measured, total = _texel_means(texel[exact], radiance[exact], weight[exact], len(highest))
    least = np.where(total[:, None] > 0, measured, highest)
    raised = np.where(clipped[:, None], np.maximum(radiance, least[texel]), radiance)
    mean, total = _texel_means(texel, raised, weight, len(highest))
    return mean.reshape(*shape, 3), (total > 0).reshape(shape)


def _texel_means(
    texel: np.ndarray, radiance: np.ndarray, weight: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (count, 3) of the pixels (N,) of each texel, and the sum of their weights (count,)."""
    total = np.bincount(texel, weight, count)
    sums = [np.bincount(texel, weight * radiance[:, c], count) for c in range(3)]
    return np.stack(sums, axis=1) / np.maximum(total, 1e-12)[:, None], total


def _observed(
    dataset: Dataset, shards: list[FootprintSamples]
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], float]:
    """Open training pixels, and their share of all pixels' weight.

    Of each pixel direction (N, 3), radiance (N, 3), weight (N,) and whether it is clipped (N,).
    """
    directions, radiances, weights, clipped, everything = [], [], [], [], 0.0
    for samples in shards:
        for index, view in enumerate(samples.views):
            image, valid = dataset.image(view)
            pixel = np.flatnonzero(open_pixels(samples, index) & (valid > 0))
            directions.append(pixel_directions(dataset.camera(view), pixel))
            radiances.append(image.reshape(-1, 3)[pixel])
            weights.append(valid.ravel()[pixel])
            clipped.append(dataset.clipped(view).ravel()[pixel])
            everything += float(valid.sum())
    weight = np.concatenate(weights).astype(np.float64)
    share = float(weight.sum() / max(everything, 1e-12))
    return (np.concatenate(directions), np.concatenate(radiances), weight, np.concatenate(clipped)), share


def filled(radiance: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Continue a map smoothly into the texels that are not ``seen``: Laplace's equation on the sphere.

    The result stays between the smallest and largest seen values. Far from what is seen it tends to a mean of them.

    Parameters
    ----------
    radiance, seen
        (h, w, 3) and (h, w) bool, at least one texel seen.

    Returns
    -------
    (h, w, 3) float32.
    """
    if seen.all():
        return radiance.astype(np.float32)
    size = seen.size
    a, b, flow = sphere_edges(*seen.shape)
    graph = coo_matrix((flow, (a, b)), shape=(size, size))
    graph = (graph + graph.T).tocsr()
    laplace = (diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsc()
    free, fixed = np.flatnonzero(~seen), np.flatnonzero(seen)
    values = radiance.reshape(-1, 3).astype(np.float64).copy()
    values[free] = spsolve(laplace[free][:, free], -(laplace[free][:, fixed] @ values[fixed]))
    return np.maximum(values, 0).reshape(radiance.shape).astype(np.float32)
