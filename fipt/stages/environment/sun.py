"""A sun that no pixel sees, told by where it shines in the room.

Sunlight through a window lights a piece of the floor, with a sharp border, and a map of some degrees a texel cannot
explain that. Each direction of the sky says which blocks of the surface a sun there would light, by V (share that it
reaches, times the cosine). With the radiance C of a block, less what it mirrors of the room beyond what it mirrors of a
sun, the light E over pi that is known, and a sun's power P,

    H ln C = H ln(E + P V) + error,        (H x)_i = x_i - mean of x over the blocks around i that may be of its colour

H leaves out what is smooth: reflectances, and errors of the light. Of all directions and powers, those win that make
the differences most likely (Student's t, its width measured). Lit blocks that look dark speak against a direction as
much as bright ones speak for it. Other errors speak for some direction, too, but hardly more for one than for others:
a sun is believed if no direction far from it explains nearly as much, and no disc of many degrees clearly more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from fipt.conventions import F0_DIELECTRIC
from fipt.render.directions import all_around
from fipt.render.scene import RayScene
from fipt.robust import deviation
from fipt.scene.environment import EnvironmentMap
from fipt.scene.sun import with_sun
from fipt.scene.surface_blocks import FREEDOM, GLOSSY, LEAST_SIGMA, Blocks, errors_alike

_DIRECTIONS = 8192
"""Directions of the whole sphere that are tried, 2.3 degrees apart: a step of 12 cm where a sun shines 3 m far."""
_HORIZON = np.sin(np.radians(2.0))
"""Sine of the least height of a sun: below, trees and houses hide it."""
_BEST = 4
"""Directions of these around which finer ones are tried."""
_FINER = (2.0, 0.7)
"""Degrees around each of them in which finer ones are tried, one step after the other."""
_EXACT = (0.7, 0.25)
"""The same around the one that was found, by smaller pieces of surface."""
_AROUND = 60
"""Directions of such a step."""
_POWERS = 2.0 ** np.arange(-1, 9.6, 1.5)
"""Light of a sun that is tried, in medians of what lights the room: sunlight has 100,000 lux, a dim room 300."""
_STEPS = np.linspace(np.log(_POWERS[0] / 2), np.log(_POWERS[-1] * 2), 101)
"""The same for the power of what is found, as logarithms."""
_FINER_STEPS = np.linspace(-1, 1, 21) * (_STEPS[1] - _STEPS[0])
"""The same around the best of these."""
_RADII = np.radians((0.27, 0.75, 1.5))
"""Radii of the disc: of the sun, behind haze, and of the discs of 3 degrees that scene files' directional light has."""
_LARGER = 1.13
"""Times the gain of a smaller disc that a larger one needs: 1.11 it has since pixels are as wide as its border."""
_GLOW = np.radians(6.0)
"""Radius of a disc that is no sun: a bright part of the sky, for which the map has texels."""
_RAYS = 16
"""Rays to points of a disc."""
_CHANCE = 1e-3
"""Probability of a sun by chance: with the number of directions, it says which gain is believed."""
_FAR = np.cos(np.radians(15.0))
"""Cosine of the angle from the best direction beyond which another explains something else."""
_NEIGHBOURS = 24
"""Blocks around a block: a disc of five blocks across."""
_LEAST_NEIGHBOURS = 4
"""Neighbours without which a block is not compared."""
_LEAST_GAIN = 1e-3
"""Gain of a channel, in nats, below which there is no sun: sums that are equal differ by their rounding."""
_ENOUGH = 0.5
"""Share of the gain of all blocks that those without borders have at least, else all of them tell the sun's power."""
_ROWS = 512
"""Rows of a map with a sun: its texels are two thirds as wide as the sun."""
_MIRRORED = 0.5 * F0_DIELECTRIC
"""Reflectance for what surface mirrors of a room, less that of the sun: no view sees smooth surface mirror the sun
(0.04), and rough surface mirrors both (0)."""
_MOST_MIRRORED = 0.5
"""Share of a block's radiance that it mirrors, at most: black surface has little else."""
_CHUNK = 256
"""Directions that are judged at a time."""


@dataclass(frozen=True)
class FoundSun:
    """A disc in the sky.

    Attributes
    ----------
    direction
        (3,) unit world direction to its centre.
    irradiance
        (3,) what it gives to a surface that faces it.
    radius
        Radians.
    gain
        By how much it raises the log likelihood of the light in the room.
    """

    direction: np.ndarray
    irradiance: np.ndarray
    radius: float
    gain: float

    @property
    def figures(self) -> dict[str, Any]:
        """The same for the stage's stats."""
        return {
            "direction": self.direction.tolist(),
            "irradiance": self.irradiance.tolist(),
            "radius_degrees": float(np.degrees(self.radius)),
            "gain": self.gain,
        }

    def added_to(self, sky: EnvironmentMap) -> EnvironmentMap:
        """A map of the sky with the sun, in texels that are as small."""
        return with_sun(sky, self.direction, self.irradiance, self.radius, _ROWS)


class SunSearch:
    """The matte blocks of a room, and rays from them to the sky.

    Parameters
    ----------
    scene
        What rays are traced against.
    blocks
        Pieces of seen surface, smaller than what a window lights.
    """

    def __init__(self, scene: RayScene, blocks: Blocks) -> None:
        self.scene, self._blocks = scene, blocks
        self.matte = np.flatnonzero(blocks.spread < GLOSSY)
        self.position, self.normal = blocks.position[self.matte], blocks.normal[self.matte]
        self.radiance = np.maximum(blocks.radiance[self.matte], 1e-6)
        self.around = _around(self.position[:, 0], blocks.group[self.matte])
        self.compared = np.flatnonzero(np.diff(self.around.indptr) >= _LEAST_NEIGHBOURS)

    def find(self, light: np.ndarray, seen: EnvironmentMap) -> FoundSun | None:
        """Look for a sun in the whole sky; None where the light in the room does not ask for one.

        Parameters
        ----------
        light
            (N, 3) irradiance over pi that is known at all blocks.
        seen
            Map whose radiance is 1 where pixels look and else 0: no sun can be where they look.
        """
        around = all_around(_DIRECTIONS) @ seen.map_from_world  # of a map with y up: now of the world
        tried, judge = around[_possible(around, seen)], _Judge(self, light)
        if len(tried) == 0 or len(self.compared) == 0:
            return None
        chunks = [tried[first : first + _CHUNK] for first in range(0, len(tried), _CHUNK)]
        gains = np.concatenate([judge.gains(self.lit(chunk, 0)) for chunk in chunks])
        best = tried[int(np.argmax(gains))]
        others, enough = max(gains[tried @ best < _FAR].max(initial=0), 0), np.log(len(tried) / _CHANCE)
        if gains.max() - others < enough:
            return None
        near = tried[np.argsort(-gains, kind="stable")[:_BEST]]
        direction, _ = max((self._finer(judge, each, seen) for each in near), key=lambda found: found[1])
        suns = self._of_sizes(judge, direction)
        glow = judge.power(self.disc(direction, _GLOW), direction, _GLOW)
        sun = _smallest(suns)
        sharp = glow.gain < max(each.gain for each in suns) + enough
        return sun if sharp and sun.gain > others + enough else None

    def measured(self, light: np.ndarray, direction: np.ndarray) -> FoundSun:
        """The sun in a direction, with its power and its size; ``light`` as in `find`.

        Borders of its patches tell its size. They do not tell its power: a mesh that is off by a centimetre lights
        other parts of these blocks.
        """
        sun = _smallest(self._of_sizes(_Judge(self, light), direction))
        points = range(self.position.shape[1])
        share = np.mean([self.lit(direction[None], k)[:, 0] > 0 for k in points], axis=0)
        rows = self.matte[(share == 0) | (share == 1)]
        clear = SunSearch(self.scene, self._blocks.chosen(rows))
        power = _Judge(clear, light[rows]).power(clear.disc(direction, sun.radius), direction, sun.radius)
        # without borders there may be nothing dark beside what is lit, as on a rug
        enough = power.irradiance.all() and power.gain > _ENOUGH * sun.gain
        return replace(power, gain=sun.gain) if enough else sun

    def exact(self, light: np.ndarray, direction: np.ndarray, seen: EnvironmentMap) -> np.ndarray:
        """(3,) the best possible direction close to another; ``light`` and ``seen`` as in `find`."""
        return self._finer(_Judge(self, light), direction, seen, _EXACT)[0]

    def _of_sizes(self, judge: "_Judge", direction: np.ndarray) -> list[FoundSun]:
        """Suns in a direction, from the smallest to the largest, each with its best power."""
        return [judge.power(self.disc(direction, radius), direction, radius) for radius in _RADII]

    def disc(self, direction: np.ndarray, radius: float) -> np.ndarray:
        """(M, R) share of a disc that each point of the matte blocks sees, times the cosine."""
        turns = np.arange(_RAYS) * np.pi * (3 - np.sqrt(5))
        away = np.tan(radius) * np.sqrt((np.arange(_RAYS) + 0.5) / _RAYS)
        rays = _tilted(direction, away * np.cos(turns), away * np.sin(turns))
        return np.stack([self.lit(rays, k).mean(axis=1) for k in range(self.position.shape[1])], axis=1)

    def lit(self, directions: np.ndarray, point: int) -> np.ndarray:
        """(M, D) cosine of a point of each block with directions (D, 3) in which it leaves the room; 0 elsewhere."""
        position, normal = self.position[:, point], self.normal[:, point]
        cos = normal @ directions.T.astype(np.float32)
        row, column = np.nonzero(cos > 0)
        origin = (position + self.scene.epsilon * normal)[row].astype(np.float32)
        _, triangle = self.scene.intersect(origin, directions[column].astype(np.float32))
        cos[cos <= 0] = 0
        met = triangle >= 0
        cos[row[met], column[met]] = 0
        return cos

    def _whole(self, directions: np.ndarray) -> np.ndarray:
        """(M, D) the same as a mean over the points of each block."""
        return np.mean([self.lit(directions, k) for k in range(self.position.shape[1])], axis=0)

    def _finer(
        self, judge: "_Judge", direction: np.ndarray, seen: EnvironmentMap, steps: Sequence[float] = _FINER
    ) -> tuple[np.ndarray, float]:
        """The best possible direction near another, which is possible, and its gain; ``steps`` are in degrees."""
        best, most = direction, -np.inf
        turns = np.arange(_AROUND) * np.pi * (3 - np.sqrt(5))
        for degrees in steps:
            away = np.tan(np.radians(degrees)) * np.sqrt(np.arange(_AROUND) / _AROUND)
            near = _tilted(best, away * np.cos(turns), away * np.sin(turns))
            near = near[_possible(near, seen)]
            gains = judge.gains(self._whole(near))
            best, most = near[int(np.argmax(gains))], float(gains.max())
        return best, most


class _Judge:
    """Says how likely differences of radiance between blocks are under a sun, against none."""

    def __init__(self, search: SunSearch, light: np.ndarray) -> None:
        self.search = search
        self.light = np.maximum(light[search.matte], 1e-6)
        self.level = np.median(self.light, axis=0) if len(self.light) else np.ones(3)
        mirrored = np.minimum(_MIRRORED * self.light, _MOST_MIRRORED * search.radiance)
        self.color = np.log(search.radiance - mirrored)
        self.residual = self._differences(self.color - np.log(self.light))
        mean = self._differences((self.color - np.log(self.light)).mean(axis=1, keepdims=True))
        self.sigma = max(float(deviation(mean)), LEAST_SIGMA) if mean.size else LEAST_SIGMA
        place = search.position[search.compared, 0]
        self.tau = errors_alike(mean[:, 0] / self.sigma, place) if len(place) > 1 else 1.0

    def gains(self, lit: np.ndarray) -> np.ndarray:
        """(D,) gain in log likelihood of suns, each with its best power.

        ``lit`` (M, D): cosines of the blocks with them, 0 where they do not reach.
        """
        light = self.light.mean(axis=1, keepdims=True)
        color = self.color.mean(axis=1, keepdims=True)
        before = self._cost(self._differences(color - np.log(light)))
        costs = [
            self._cost(self._differences(color - np.log(light + power * self.level.mean() * lit))) for power in _POWERS
        ]
        return (before - np.min(costs, axis=0)) / self.tau

    def power(self, lit: np.ndarray, direction: np.ndarray, radius: float) -> FoundSun:
        """The sun with its best power in each channel; ``lit`` (M, R) as of `SunSearch.disc`."""
        power, gain = np.zeros(3), 0.0
        for c in range(3):
            step, _ = self._best(lit, c, _STEPS)
            step, cost = self._best(lit, c, step + _FINER_STEPS)
            gained = float(self._cost(self.residual[:, c : c + 1])[0]) - cost
            if gained > _LEAST_GAIN:
                power[c] = np.exp(step) * self.level[c]
                gain += gained / 3 / self.tau
        return FoundSun(direction, power * np.pi, radius, gain)

    def _best(self, lit: np.ndarray, channel: int, steps: np.ndarray) -> tuple[float, float]:
        """The logarithm of the power, of some ``steps``, that costs least, and its cost.

        The radiance of a block is the geometric mean of its pixels, and so is this of its points.
        """
        light = self.light[:, channel, None]
        expected, sunny = np.log(np.repeat(light, len(steps), axis=1)), lit.any(axis=1)
        sun = np.exp(steps) * self.level[channel] * lit[sunny][:, :, None]
        expected[sunny] = np.log(light[sunny][:, None] + sun).mean(axis=1)
        costs = self._cost(self._differences(self.color[:, channel, None] - expected))
        return float(steps[int(np.argmin(costs))]), float(costs.min())

    def _differences(self, values: np.ndarray) -> np.ndarray:
        """(K, D) values (M, D) of the blocks that are compared, minus the mean of their neighbours."""
        rows = self.search.compared
        return values[rows] - self.search.around[rows] @ values

    def _cost(self, left: np.ndarray) -> np.ndarray:
        """(D,) minus the log likelihood of residuals (K, D), but for a constant."""
        return 0.5 * (FREEDOM + 1) * np.log1p((left / self.sigma) ** 2 / FREEDOM).sum(axis=0)


def _smallest(suns: list[FoundSun]) -> FoundSun:
    """The smallest of some suns, unless a larger one explains clearly more."""
    best, *larger = suns
    for each in larger:
        best = each if each.gain > _LARGER * best.gain else best
    return best


def _possible(directions: np.ndarray, seen: EnvironmentMap) -> np.ndarray:
    """(D,) bool: world directions above the horizon in which no pixel looks."""
    height = (directions @ seen.map_from_world.T)[:, 1]
    return (height > _HORIZON) & (seen.lookup(directions).mean(axis=1) < 0.5)


def _around(place: np.ndarray, group: np.ndarray) -> csr_matrix:
    """(M, M) weights of the mean over each block's nearest blocks of its group."""
    if len(place) <= 1:
        return csr_matrix((len(place), len(place)))
    far = 4 * float(np.ptp(place, axis=0).max()) + 1  # groups lie so far apart
    place = np.column_stack([place, np.unique(group, return_inverse=True)[1] * far])
    distance, index = cKDTree(place).query(place, k=min(_NEIGHBOURS + 1, len(place)))
    of_group = distance < far
    of_group[:, 0] = False  # the block itself
    count = of_group.sum(axis=1)
    row = np.repeat(np.arange(len(place)), count)
    return csr_matrix((np.repeat(1 / np.maximum(count, 1), count), (row, index[of_group])), shape=(len(place),) * 2)


def _tilted(direction: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(D, 3) unit directions near another: tangents u, v (D,) of the angles between them, along two axes across."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    across /= np.linalg.norm(across)
    tilted = direction + u[:, None] * across + v[:, None] * np.cross(direction, across)
    return tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
