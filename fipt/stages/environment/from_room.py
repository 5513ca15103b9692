"""What the light in the room tells of the outside: the sky that no pixel sees, and the sun."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fipt.render.scene import RayScene
from fipt.render.sunlight import sunlight
from fipt.scene.dataset import Dataset
from fipt.scene.environment import EnvironmentMap
from fipt.scene.observed import before_shading
from fipt.scene.samples import FootprintSamples
from fipt.scene.sun import Sun
from fipt.scene.surface_blocks import LEAST_BLOCKS, Blocks, blocks_of
from fipt.stages.environment.directional import directional_mean, filled
from fipt.stages.environment.settings import AutoEnvironment, FittedMap
from fipt.stages.environment.sun import FoundSun, SunSearch
from fipt.stages.environment.unseen import RoomLight, lit_from_outside, room_light

_ROWS = 32
"""Rows of the map of what the room tells: its light hardly changes within less than 6 degrees of the sky."""
_SUN = 6000, 16, 64
"""Pieces of surface that tell of a sun, some centimetres wide; samples of each, since the border of what the sun lights
crosses many; and rays of each sample to all other light."""
_WHERE = 24_000, 4, 16
"""The same for where exactly it stands: half as wide, where pixels are that fine."""
_SUN_ROUNDS = 2
"""Estimates of the sky beside the sun and of the sun's power, in turn."""
_LOOKED_AT_ROWS = 90
"""Rows of the map of where pixels look: two degrees each, so that none lies between pixels."""

OpenPixels = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of pixels that see outside: direction (N, 3), radiance (N, 3), weight (N,), and whether it is clipped (N,)."""


@dataclass(frozen=True)
class FoundOutside:
    """What is outside.

    Attributes
    ----------
    sky
        A map without the sun.
    sun
        None where no sun is found.
    figures
        For the stage's stats.
    """

    sky: EnvironmentMap
    sun: FoundSun | None
    figures: dict[str, Any]


def outside_from_room(
    dataset: Dataset,
    shards: Sequence[FootprintSamples],
    cache: Mapping[str, np.ndarray],
    pixels: OpenPixels,
    settings: AutoEnvironment | FittedMap,
) -> FoundOutside | None:
    """Find what explains the light in the room; None where too little of the room is seen."""
    mesh, observed = dataset.mesh(), before_shading(dataset, shards)
    no_emitters, scene = np.zeros(len(mesh.triangles), bool), RayScene(mesh)
    blocks = blocks_of(observed, mesh, no_emitters, cache)
    if len(blocks.radiance) < LEAST_BLOCKS:
        return None
    seen = _SeenSky(pixels, settings)
    light = room_light(blocks, scene, cache, seen.smooth)
    sky, figures = seen.completed(blocks, light)
    without = FoundOutside(sky, None, figures)
    if not settings.sun:
        return without

    def search(most: int, points: int, rays: int) -> tuple[SunSearch, RoomLight]:
        pieces = blocks_of(observed, mesh, no_emitters, cache, most, points)
        return SunSearch(scene, pieces), room_light(pieces, scene, cache, seen.smooth, rays)

    coarse, coarse_light = search(*_SUN)
    sky, sun = seen.smooth, coarse.find(coarse_light.under(seen.smooth.radiance), seen.looked_at)
    if sun is None:
        return without
    fine, fine_light = search(*_WHERE)
    direction = fine.exact(fine_light.under(seen.smooth.radiance), sun.direction, seen.looked_at)
    for _ in range(_SUN_ROUNDS):
        sun = coarse.measured(coarse_light.under(sky.radiance), direction)
        sunlit = replace(light, inside=light.inside + _sunlit(scene, sun, blocks))
        sky, figures = seen.completed(blocks, sunlit)
    sun = coarse.measured(coarse_light.under(sky.radiance), direction)
    return FoundOutside(sky, sun, figures | {"sun": sun.figures}) if sun.irradiance.any() else without


class _SeenSky:
    """What pixels see of the outside.

    Attributes
    ----------
    smooth
        Map of what they see, continued smoothly.
    looked_at
        Map of 1 where pixels look that are not clipped, else 0.
    """

    def __init__(self, pixels: OpenPixels, settings: AutoEnvironment | FittedMap) -> None:
        rows = min(settings.resolution, _ROWS)
        self._measured, self._seen = directional_mean(*pixels, rows, settings.up)
        self.smooth = EnvironmentMap("map", filled(self._measured, self._seen), settings.up)
        direction, radiance, weight, clipped = (each[~pixels[3]] for each in pixels)
        _, looked = directional_mean(direction, radiance, weight, clipped, _LOOKED_AT_ROWS, settings.up)
        self.looked_at = EnvironmentMap("map", np.repeat(looked[..., None], 3, axis=2).astype(np.float32), settings.up)

    def completed(self, blocks: Blocks, light: RoomLight) -> tuple[EnvironmentMap, dict[str, Any]]:
        """The map that explains the radiance of blocks, given their light; and its figures."""
        radiance, figures = lit_from_outside(self._measured, self._seen, self.smooth.radiance, blocks, light)
        return replace(self.smooth, radiance=radiance), dict(figures)


def _sunlit(scene: RayScene, sun: FoundSun, blocks: Blocks) -> np.ndarray:
    """(N, 3) irradiance over pi that a sun gives to blocks, as the mean of their samples."""
    disc = Sun(sun.direction[None], sun.irradiance[None], np.array([sun.radius]))
    samples = blocks.position.shape[1]
    return np.mean([sunlight(scene, disc, blocks.position[:, k], blocks.normal[:, k]) for k in range(samples)], axis=0)
