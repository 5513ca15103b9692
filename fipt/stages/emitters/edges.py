"""Emitters without an edge: surface that goes on beyond them as bright as they are, so that it is lit.

What emits ends somewhere: at the frame of a screen, the rim of a shade. Light on a wall fades. A part of it that is
brighter than white under the light that is known ends where that is no longer so, and there nothing is to be seen.
Only the light changes there as it does on both sides.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from fipt.scene.observed import ObservedShard

_INSIDE, _OUTSIDE, _ON = 1, 3, 4
"""Pixels from the last one of an emitter to what is compared, inward and outward: the pixels between may be mixtures,
and the mesh may be off by one. And on from there, to see how light changes on either side."""
_STEP = 0.1
"""Log radiance by which an edge changes more than both of its sides do: three times the steps that are none in regions
(`fipt.stages.emitters.regions`)."""
_FADE = 0.3
"""Log radiance by which light fades over these pixels at most: what changes by more is an edge, too."""
_PLANE = 0.1
"""Slope up to which surface goes on: beyond, another one begins."""
_FAR = 3.0
"""Places of neighbouring pixels are so many footprints apart at most, on one surface that is not grazed."""
_FACING = 0.9
"""Cosine between normals of surface that goes on."""
_GOES_ON, _SHARE = 0.4, 0.35
"""Share of an emitter's rim where surface must go on for it to be told at all, and share of that without an edge above
which it is lit: the long side of a screen of two to one, where its picture grows dark, is a third."""
_LEAST = 8
"""Pixels of a rim that tell anything."""


def without_edge(shards: Sequence[ObservedShard], emitter: np.ndarray) -> np.ndarray:
    """Numbers of the emitters whose rim has no edge.

    Parameters
    ----------
    shards
        The training views.
    emitter
        (T,) int number of the emitter of each triangle, -1 for none.

    Returns
    -------
    numbers
        (N,) int64, ascending.
    """
    count = int(emitter.max(initial=-1)) + 1
    rim, plain, smooth = np.zeros((3, count))
    for shard in shards:
        for index in range(len(shard.samples.views) if len(shard.samples.position) else 0):
            for own, goes_on, fades in _rims(shard, index, emitter):
                rim += np.bincount(own, minlength=count)
                plain += np.bincount(own[goes_on], minlength=count)
                smooth += np.bincount(own[fades], minlength=count)
    return np.flatnonzero((rim >= _LEAST) & (plain > _GOES_ON * rim) & (smooth > _SHARE * plain))


def _rims(shard: ObservedShard, index: int, emitter: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield the emitter of each pixel of a rim, whether surface goes on there, and whether it does without an edge.

    Each is (N,); four times, for the lines that leave an emitter to the bottom, top, right and left.
    """
    samples, pixels = shard.samples, shard.samples.pixels(index)
    shape = samples.shapes[index]
    shows = np.asarray(samples.center[pixels]) > 0
    row = np.minimum(np.asarray(samples.offsets[pixels]), len(samples.position) - 1)
    own = np.where(shows, emitter[samples.triangle[row]], -1)
    light = np.log(np.maximum(shard.radiance[pixels].mean(axis=1), 1e-9))
    usable = shows & (shard.weight[pixels] > 0) & ~shard.clipped[pixels]

    def goes_on(here: np.ndarray, there: np.ndarray, steps: int) -> np.ndarray:
        """Whether pixels so many pixels apart show one surface, without a crease or a step of depth."""
        at, away = row[here], samples.position[row[there]] - samples.position[row[here]]
        distance, width, normal = np.linalg.norm(away, axis=1), samples.footprint[at], samples.normal[at]
        same = (normal * samples.normal[row[there]]).sum(axis=1) > _FACING
        flat = np.abs((away * normal).sum(axis=1)) < _PLANE * distance + 0.5 * width
        return usable[here] & usable[there] & same & flat & (distance < _FAR * steps * width)

    for line in _lines(shape):
        rim = (own[line[2]] >= 0) & (own[line[3]] != own[line[2]])
        deep, inner, here, beside, outer, far = (each[rim] for each in line)
        inner = np.where(own[inner] == own[here], inner, here)
        plain = (own[beside] < 0) & (own[outer] < 0) & goes_on(inner, outer, _INSIDE + _OUTSIDE)
        within, beyond = light[deep] - light[inner], light[outer] - light[far]
        known = [(own[deep] == own[here]) & goes_on(deep, inner, _ON), (own[far] < 0) & goes_on(outer, far, _ON)]
        fades = (within * known[0] + beyond * known[1]) / np.maximum(known[0] + known[1].astype(int), 1)
        fades = np.clip(fades, -_FADE, _FADE)
        step = light[inner] - light[outer]
        yield own[here], plain, plain & (np.minimum(np.abs(step), np.abs(step - fades)) < _STEP)


def _lines(shape: tuple[int, int]) -> Iterator[tuple[np.ndarray, ...]]:
    """Numbers of the pixels on lines across every pixel of a picture: from deep inside to far outside, (N,) each."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    places = (-_INSIDE - _ON, -_INSIDE, 0, 1, _OUTSIDE, _OUTSIDE + _ON)
    for axis in (0, 1):
        for turn in (1, -1):
            at = np.arange(shape[axis])[::turn]
            # what lies outside of the picture is what lies at its border
            reach = (np.clip(np.arange(len(at)) + place, 0, len(at) - 1) for place in places)
            yield tuple(np.take(number, at[own], axis).ravel() for own in reach)
