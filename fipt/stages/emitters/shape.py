"""The shape of emitters: which triangles belong to a region that emits, up to half of the step of radiance at its edge.

Pixels at an edge see both sides, and triangles there have radiance in between. An ideal picture reaches half of the
step exactly at the edge. So every triangle that is smaller than a pixel and lies within the blur of an emitter belongs
to it if it has more than the mean of the radiance inside and outside. That takes in the small regions between (holes,
speckles) and removes rims that would be emitters of their own.

What such a triangle has is the mean of the pixels around it, also of those that it shares with other surface, by their
shares: pixels that only one surface fills are all on one side of the edge.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import grouped_median
from fipt.robust import NORMAL
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.fragments import LEAST_DIFFERENCE, SIGMA
from fipt.stages.emitters.regions import ALIKE, PIXELS, Surface, by_part

_BLUR = 2.0
"""Widths of a pixel within which an edge mixes both sides: one for the pixel, one for the mesh being off by one."""
_NEAREST = 8
"""Triangles of emitters that are looked at around each triangle."""
_AROUND = 6
"""Pixels around a small triangle that are averaged: the fewest that surround it."""
_LEAST_SHARE = 0.2
"""Share of a pixel below which it says little of a surface."""
_THIN = 0.9
"""Share of its area within the blur of a brighter emitter that makes a region a rim of that."""


def shaped(mesh: Mesh, surface: Surface, emits: np.ndarray, shards: Sequence[ObservedShard]) -> np.ndarray:
    """(T,) int64 region whose light a triangle sends out, -1 where it sends out none.

    Parameters
    ----------
    shards
        The training views.
    emits
        (R,) bool, regions that emit.
    """
    bright = surface.radiance.mean(axis=1)
    own = np.append(emits, False)[surface.region]  # the last for what has no region
    result = np.where(own, surface.region, -1)
    # what is larger than a pixel has pixels of its own
    small = np.flatnonzero((surface.region >= 0) & (np.sqrt(mesh.areas) <= surface.width))
    if not own.any() or len(small) == 0:
        return result
    inside = _medians(bright[own], surface.region[own], surface.count)
    distance, near = _emitters_around(mesh, surface, own, small)
    dark = ~own[small] & (distance[:, 0] > _BLUR) & (distance[:, 0] <= 2 * _BLUR)
    # a speckle of a globe in the air may be all that there is around it
    dark &= bright[small] < (inside - _spread(bright[own], surface.region[own], inside))[near[:, 0]]
    outside = _medians(bright[small[dark]], near[dark, 0], surface.count)
    level = np.where(distance <= _BLUR, inside[near], -1.0)
    region = near[np.arange(len(small)), level.argmax(axis=1)]  # the brightest emitter nearby
    level = level.max(axis=1)
    close = level >= 0
    rim = _rims(mesh, surface, small, region, close & own[small])
    asked = close & (~own[small] | (surface.region[small] == region) | rim[surface.region[small]])
    blurred, near_edge = small[asked & (surface.pixels[small] < PIXELS)], np.zeros(len(bright), bool)
    near_edge[small[distance[:, 0] <= 2 * _BLUR]] = True
    bright[blurred] = _mixed(mesh, surface, shards, near_edge, blurred, bright[blurred])
    passes = bright[small] > 0.5 * (level + outside[region])
    result[small[asked]] = np.where(passes, region, -1)[asked]
    return result


def _mixed(
    mesh: Mesh,
    surface: Surface,
    shards: Sequence[ObservedShard],
    zone: np.ndarray,
    triangles: np.ndarray,
    default: np.ndarray,
) -> np.ndarray:
    """(N,) mean radiance of the pixels around small triangles (N,), by shares; ``default`` (N,) where there are none.

    ``zone`` (T,) are the triangles whose samples may be around.
    """
    columns: list[tuple[np.ndarray, ...]] = []
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel = samples.of_view(index), samples.pixel_of_sample(index) + samples.pixels(index).start
            triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own])
            use = np.flatnonzero(zone[triangle] & (share >= _LEAST_SHARE) & (shard.weight[pixel] > 0))
            arrays = (samples.position[own][use], samples.normal[own][use], samples.footprint[own][use])
            columns.append((*arrays, share[use], shard.radiance[pixel[use]].mean(axis=1), surface.part[triangle[use]]))
    place, normal, width, share, radiance, part = (np.concatenate(column) for column in zip(*columns, strict=True))
    if len(place) == 0 or len(triangles) == 0:
        return default
    centers = mesh.corners[triangles].mean(axis=1)
    places = by_part(np.concatenate([place, centers]), np.concatenate([part, surface.part[triangles]]))
    nearest = range(1, min(_AROUND, len(place)) + 1)
    distance, near = cKDTree(places[: len(place)]).query(places[len(place) :], k=nearest, workers=-1)
    facing = np.abs((mesh.normals[triangles][:, None] * normal[near]).sum(axis=-1)) > ALIKE
    reach = 0.5 * (width[near] + np.sqrt(mesh.areas[triangles])[:, None])
    weight = share[near] * (facing & (distance <= reach))
    total = weight.sum(axis=1)
    return np.where(total > 0, (weight * radiance[near]).sum(axis=1) / np.maximum(total, 1e-9), default)


def _spread(values: np.ndarray, region: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(R,) by how much a region's own values (N,) may differ from its median ``inside`` (R,); half of it at most."""
    deviations = NORMAL * _medians(np.abs(values - inside[region]), region, len(inside))
    return np.clip(SIGMA * deviations, LEAST_DIFFERENCE * inside, 0.5 * inside)


def _medians(values: np.ndarray, region: np.ndarray, regions: int) -> np.ndarray:
    """(R,) median of the values (N,) of each region; 0 where there is none."""
    result = np.zeros(regions)
    found, index = np.unique(region, return_inverse=True)
    result[found] = grouped_median(values, index.reshape(-1), len(found))
    return result


def _emitters_around(mesh: Mesh, surface: Surface, own: np.ndarray, small: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N, K), in widths of a pixel, and region of the nearest emitting triangles to those of ``small``."""
    places, seeds = by_part(mesh.corners.mean(axis=1).astype(np.float64), surface.part), np.flatnonzero(own)
    nearest = range(1, min(_NEAREST, len(seeds)) + 1)
    distance, near = cKDTree(places[seeds]).query(places[small], k=nearest, workers=-1)
    return distance / surface.width[small, None], surface.region[seeds[near]]


def _rims(mesh: Mesh, surface: Surface, small: np.ndarray, region: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(R,) bool: regions nearly all of which is in the blur of another, brighter one."""
    rows, areas, known = near & (region != surface.region[small]), mesh.areas, surface.region >= 0
    within = np.bincount(surface.region[small[rows]], areas[small[rows]], surface.count)
    return within > _THIN * np.bincount(surface.region[known], areas[known], surface.count)
