"""The background stage: stated, given, or fitted to the pixels that see no surface."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

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
from fipt.scene.samples import FootprintSamples
from fipt.stages.environment.directional import directional_mean, filled
from fipt.stages.environment.from_room import OpenPixels, outside_from_room
from fipt.stages.environment.settings import ConstantEnvironment, EnvironmentSettings, GivenEnvironment, NoEnvironment

_ENOUGH = 1e-3
"""Share of the training pixels that must see outside before mode auto believes that there is one."""


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
    outside = outside_from_room(dataset, shards, cache(), pixels, settings)
    if outside is None:
        return found
    stats.update(outside.figures)
    sky = outside.sky
    if len(sky.radiance) != len(seen):
        elsewhere = sky.lookup(texel_directions(*seen.shape) @ found.map_from_world).reshape(mean.shape)
        sky = replace(found, radiance=np.where(seen[..., None], mean, elsewhere).astype(np.float32))
    return sky if outside.sun is None else outside.sun.added_to(sky)


def _observed(dataset: Dataset, shards: list[FootprintSamples]) -> tuple[OpenPixels, float]:
    """Open training pixels, and their share of all pixels' weight."""
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
