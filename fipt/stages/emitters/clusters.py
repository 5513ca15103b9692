"""Emitters that give more light than was found of them, as what they light tells.

A scan has half of a bulb of two pixels, and a lamp of a few pixels is hardly larger than its rim. Its radiance is
measured, its area is not. A closed piece of the mesh that emits all over is a whole lamp. Several lamps near each
other, as those of a chandelier, light the same: they are one here, a *cluster* of emitters.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.meshing.topology import border_vertices, pieces
from fipt.scene.emitters import Emitters
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import median_footprint
from fipt.scene.surface_blocks import GLOSSY, LEAST_BLOCKS, Blocks, blocks_of, spacing
from fipt.stages.emitters.extract import Extracted
from fipt.stages.emitters.reflectance_fit import Problem, minimum
from fipt.stages.emitters.unseen import Lights, seen_light
from fipt.stages.emitters.unseen_fit import searched

log = logging.getLogger(__name__)

_RAYS = 128
"""From a block to each cluster."""
_MOST = 64
"""Clusters that are asked about, the strongest."""
_NEIGHBOURS = 16
"""Emitters around one with which it may be of one cluster; all pairs would be many where each triangle emits alone."""
_DARK = 0.1
"""Share of a closed piece's area that does not emit, above which it is no lamp by itself."""
_ODDS = 100
"""Beforehand, that a cluster is as it was found. One that was raised in the round before needs no such odds: what is
hardly worth it would come and go by round."""


def with_what_they_light(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    extracted: Extracted,
    cache: Mapping[str, np.ndarray],
    environment: EnvironmentMap,
    before: np.ndarray,
    accepted: np.ndarray,
) -> tuple[Emitters, tuple[str, ...]]:
    """Emitters, brighter where what they light says so, and warnings about these.

    What is in doubt, guessed or accepted by a person stays as it is, and a lamp that is whole.

    Parameters
    ----------
    shards
        The training views.
    before
        (T,) bool: triangles that were raised in the round before.
    accepted
        (T,) bool: triangles that emit what the photographs show, as a person said.
    """
    found = extracted.emitters
    certain = ~extracted.in_doubt & ~found.guessed & ~(accepted | _whole(mesh, found))[found.triangle]
    certain = np.flatnonzero(certain & (found.power > 0))
    if len(certain) == 0:
        return found, ()
    blocks = blocks_of(shards, mesh, np.isin(np.arange(len(mesh.triangles)), found.triangle), cache)
    if len(blocks.radiance) < LEAST_BLOCKS:
        return found, ()
    number = np.full(len(found.triangle), -1)
    number[certain] = _clusters(mesh, found.chosen(certain), spacing(blocks.position[:, 0]))
    unseen = np.zeros(len(mesh.triangles), bool)  # none: what no view shows reflects as the seen surface beside it
    lights = Lights(mesh, unseen, cache, found, environment, blocks.brightest)
    straight = _straight(blocks, lights, [found.triangle[number == k] for k in range(number.max() + 1)])
    unsure = _rims(found, number, median_footprint([shard.samples for shard in shards]))
    stands = np.bincount(number[certain] + 1, before[found.triangle[certain]])[1:] > 0
    more = beyond(blocks, seen_light(blocks, lights).seen, straight, unsure, stands)
    raised = np.append(more, 0)[number].astype(np.float32)
    factor = 1 + raised[:, None]
    brighter = replace(found, radiance=found.radiance * factor, error=found.error * factor, raised=raised)
    return brighter, tuple(_in_words(mesh, found, number == k, more[k]) for k in np.flatnonzero(more))


def _whole(mesh: Mesh, found: Emitters) -> np.ndarray:
    """(T,) bool: triangles of closed pieces of the mesh that emit all over; nothing of such a lamp is missing."""
    piece, emits = pieces(mesh), np.isin(np.arange(len(mesh.triangles)), found.triangle)
    open_ = border_vertices(mesh)[mesh.triangles].any(axis=1)
    dark = np.bincount(piece, mesh.areas * ~emits) > _DARK * np.bincount(piece, mesh.areas)
    return ~np.isin(piece, piece[open_]) & ~dark[piece]


def beyond(
    blocks: Blocks, seen: np.ndarray, straight: np.ndarray, unsure: np.ndarray, stands: np.ndarray
) -> np.ndarray:
    """Find clusters that give more light than was found of them.

    All of them may give more or less, within what is not sure of their size. Those count that are worth the price of a
    patch, against the odds: the others make up for errors of the light.

    Parameters
    ----------
    seen
        (N, 3) irradiance over pi of the blocks.
    straight
        (N, K, 3) what of it comes straight from each cluster.
    unsure
        (K,) relative standard deviation of the light of each beforehand, above 0.
    stands
        (K,) bool: those for which there are no odds against it.

    Returns
    -------
    ndarray
        (K,) share of its light that each gives beyond it, 0 or more.
    """
    light, result = seen.mean(axis=1), np.zeros(len(unsure))
    use = np.flatnonzero((blocks.spread < GLOSSY) & (light > 1e-3 * np.median(light)))
    if len(use) < max(2 * len(np.unique(blocks.group[use])), LEAST_BLOCKS):
        return result
    _, group = np.unique(blocks.group[use], return_inverse=True)
    given = straight[use].mean(axis=2)
    given *= np.minimum(1, 0.95 * light[use] / np.maximum(given.sum(axis=1), 1e-12))[:, None]  # both have noise
    log_color, none = np.log(blocks.radiance[use].mean(axis=1)), np.zeros((len(use), 0))
    problem = Problem(log_color, light[use], none, group, clusters=given, unsure=unsure)
    state, _, problem = searched(problem, blocks.position[use, 0])
    price = 0.5 * np.log(len(use) / problem.tau) + np.log(len(unsure)) + np.where(stands, 0, np.log(_ODDS))
    for cluster in np.flatnonzero(state.more > 0):
        others = replace(problem, clusters=given * (np.arange(len(unsure)) != cluster))
        gain = minimum(others, (), state).cost - state.cost
        log.debug("cluster %d gives %.2f times its light: gain %.1f nats", cluster, 1 + state.more[cluster], gain)
        if gain > price[cluster]:
            result[cluster] = state.more[cluster]
    return result


def _clusters(mesh: Mesh, found: Emitters, reach: float) -> np.ndarray:
    """(E,) int64 number of the cluster of each emitting triangle, -1 for none; centres within ``reach`` are one."""
    weight = found.area.astype(np.float64)
    area, power = np.bincount(found.emitter, weight), np.bincount(found.emitter, found.power)
    weighted = mesh.corners[found.triangle].mean(axis=1) * weight[:, None]
    center = np.stack([np.bincount(found.emitter, column) for column in weighted.T], axis=1) / area[:, None]
    neighbours = min(_NEIGHBOURS + 1, len(center))
    distance, near = cKDTree(center).query(center, k=list(range(1, neighbours + 1)), distance_upper_bound=reach)
    first, place = np.nonzero(np.isfinite(distance))
    cluster = connected_groups(np.stack([first, near[first, place]]), len(area))
    strength = np.bincount(cluster, power)
    strongest = np.argsort(-strength, kind="stable")[:_MOST]
    number = np.full(len(strength), -1)
    number[strongest] = np.arange(len(strongest))
    return number[cluster][found.emitter]


def _rims(found: Emitters, number: np.ndarray, width: float) -> np.ndarray:
    """(K,) area of rims a pixel wide around the emitters of a cluster, taken for discs, over their own area.

    ``number`` (E,) is the cluster of each triangle, -1 for none.
    """
    own = number >= 0
    emitter, area = found.emitter[own], found.area[own]
    cluster = np.zeros(int(emitter.max()) + 1, np.int64)
    cluster[emitter] = number[own]
    rim = np.bincount(cluster, np.sqrt(4 * np.pi * np.bincount(emitter, area)) * width)
    return np.clip(rim / np.bincount(number[own], area), 1e-3, 1)


def _straight(blocks: Blocks, lights: Lights, clusters: Sequence[np.ndarray]) -> np.ndarray:
    """(N, K, 3) irradiance over pi of blocks straight from each cluster of triangles."""
    rows, points = blocks.position.shape[:2]
    flat = blocks.position.reshape(-1, 3), blocks.normal.reshape(-1, 3)
    light = [lights.straight(*flat, triangles, _RAYS // points) for triangles in clusters]
    return np.stack([each.reshape(rows, points, 3).mean(axis=1) for each in light], axis=1)


def _in_words(mesh: Mesh, found: Emitters, own: np.ndarray, more: float) -> str:
    """What a person should know of a cluster, of which the triangles are ``own`` (E,)."""
    centers = mesh.corners[found.triangle[own]].mean(axis=1)
    place = ", ".join(f"{v:.2f}" for v in np.average(centers, axis=0, weights=found.area[own]))
    return (
        f"the lamp near ({place}) lights its surroundings {1 + more:.1f} times as much as what was found of it would: "
        "the mesh may lack a part of it, and what there is of it counts as that much brighter"
    )
