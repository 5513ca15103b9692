"""Light that no view shows, first half: unseen surface as patches, and the light that each of them would give.

What seen surface sends back is measured: the radiance cache has it, whatever lights it. So the irradiance of a point is
known up to the rays that end on unseen surface, and linear in what is emitted there:

    E_i = E_seen_i + sum_p T_ip (0.5 E_p + e_p),        C_i = rho_i E_i

E is irradiance over pi, e the radiance that a patch emits, C the radiance that is seen. Unseen surface reflects as
well, taken for grey of `GREY`; where it is the rest of a plane that views show, E_seen has its light, and it reflects
nothing beside that. Nothing here depends on the fit or on its materials.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fipt.render.directions import cosine_directions, even_cosine_directions
from fipt.render.scene import RayScene
from fipt.render.sunlight import sunlight
from fipt.scene.emitters import Emitters, emits
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh, points_of
from fipt.scene.sun import split
from fipt.scene.surface_blocks import Blocks
from fipt.scene.voxels import SeenRadiance
from fipt.stages.emitters.unseen_surface import Patches

GREY = 0.5
"""Reflectance of unseen surface: the middle of what rooms are painted with."""
_RAYS = 512
"""Rays from a block, spread evenly: the standard error of its seen light is below 4 % of the spread of what it sees."""
_TO_EMITTERS = 0.25
"""Rays to points of emitters for each ray of the cosine lobe, which hardly meets a small one."""
_LEAST_ODDS = 0.1
"""Of a ray to a point of an emitter, against the cosine lobe: near points of a large one would make noise."""
_PATCH_POINTS = 4
"""Points of a patch at which light arrives, and from which it leaves."""
_SMALL_POINTS = 16
"""Points of a patch of a small part: a strip is one patch, however long, and a bulb stands in a shade."""
_TOWARDS = 2
"""Points of a block from which rays go to those of each patch."""
_BOUNCES = 4
"""Of light on unseen surface: where nothing else is, 6 % of it is left out."""
_PATHS = 1 << 16
"""Paths over unseen surface at a time."""
_FEW_PATCHES = 16
"""Of more patches, as of a pane, one point each is enough."""
_MORE_POINTS = 64
"""Points of a patch of which it is known that it emits: the edge of a shade cuts the light of a bulb."""


@dataclass(frozen=True)
class Transport:
    """How light gets to N blocks.

    Attributes
    ----------
    seen
        (N, 3) irradiance over pi of what is seen, and of what unseen surface reflects of it.
    unseen
        (N, P) irradiance over pi for each unit of radiance that a patch emits, interreflection of unseen surface
        included.
    straight
        (N, P) what of that comes without any reflection.
    open
        (N,) share of the cosine lobe that leaves the mesh to where nothing is known.
    """

    seen: np.ndarray
    unseen: np.ndarray
    straight: np.ndarray
    open: np.ndarray

    @classmethod
    def without(cls, seen: np.ndarray, outside: np.ndarray) -> "Transport":
        """What is seen alone, before any patch is traced."""
        none = np.zeros((len(seen), 0))
        return cls(seen, none, none, outside)


class Lights:
    """What rays find: radiance that is measured, or that of the plane around, or unseen surface.

    Parameters
    ----------
    hidden
        (T,) bool: triangles that no view shows.
    cache
        The radiance cache.
    found
        Emitters that views show: their triangles have their radiance.
    brightest
        Mean radiance that no other seen surface exceeds. Records beside a lamp hold pixels of it: they would count its
        light twice, and few rays meet them, which makes noise.

    Attributes
    ----------
    beyond
        (T, 2, 3) radiance of both sides of hidden triangles in which a plane goes on that views show (`Blocks.beyond`);
        NaN elsewhere.
    met, black
        (T,) int64: how many rays have met each triangle so far, and how many of these found nothing known.
    """

    def __init__(
        self,
        mesh: Mesh,
        hidden: np.ndarray,
        cache: Mapping[str, np.ndarray],
        found: Emitters,
        environment: EnvironmentMap,
        brightest: float = np.inf,
    ) -> None:
        self.brightest = brightest
        self.mesh, self.hidden = mesh, hidden
        self.environment, self.sun = split(environment)
        self.beyond = np.full((len(mesh.triangles), 2, 3), np.nan, np.float32)
        self.met, self.black = np.zeros((2, len(mesh.triangles)), np.int64)
        self.scene = RayScene(mesh)
        self.emitted = np.full((len(mesh.triangles), 3), np.nan)
        self.emitted[found.triangle] = found.radiance
        self.sides = np.zeros(len(mesh.triangles), np.int8)
        self.sides[found.triangle] = found.sides
        power = found.area.astype(np.float64) * found.radiance.mean(axis=1)
        self.emitters = found.triangle[power > 0]
        self._upto = np.cumsum(power[power > 0])
        self._chance = np.zeros(len(mesh.triangles))  # of a point of an emitter, for each square metre
        self._chance[found.triangle] = power / np.maximum(power.sum() * found.area, 1e-12)
        self._seen = SeenRadiance(cache)

    def arriving(
        self, position: np.ndarray, normal: np.ndarray, count: int, noted: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Integrate what arrives at points by ``count`` cosine-distributed rays each, and by rays to emitters and sun.

        Both kinds find emitters; the balance heuristic (Veach and Guibas 1995) weighs them. Where they are ``noted``,
        `met` and `black` count those of the lobe.

        Returns
        -------
        (N, 3) irradiance over pi of what is known, and (N,) share of the rays that leave the mesh to where nothing is
        known.
        """
        rng = np.random.default_rng(0)
        known, open_ = np.zeros((len(position), 3)), np.zeros(len(position))
        aimed = max(int(_TO_EMITTERS * count), 1) if len(self.emitters) else 0
        chunk = max((1 << 20) // count, 1)
        for start in range(0, len(position), chunk):
            rows = slice(start, start + chunk)
            here = len(position[rows])
            p, n = np.repeat(position[rows], count, axis=0), np.repeat(normal[rows], count, axis=0)
            row, shift = np.repeat(np.arange(here), count), np.repeat(rng.random((here, 2)), count, axis=0)
            direction = even_cosine_directions(n, np.tile(np.arange(count), here), shift)
            origin = p + self.scene.epsilon * n
            distance, triangle = self.scene.intersect(origin, direction)
            radiance, leaves = self._found(origin, direction, distance, triangle, noted)
            cos = np.maximum((direction * n).sum(axis=1), 0)
            radiance *= (count / (count + aimed * self._odds(direction, cos, distance, triangle)))[:, None]
            for c in range(3):
                known[rows, c] += np.bincount(row, radiance[:, c], here) / count
            open_[rows] += np.bincount(row[leaves], minlength=here) / count
            if aimed:
                known[rows] += self._aimed(position[rows], normal[rows], aimed, count, rng)
        if self.sun is not None:
            known += sunlight(self.scene, self.sun, position, normal)
        return known, open_

    def _odds(self, direction: np.ndarray, cos: np.ndarray, distance: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(N,) density of rays to emitters over that of the cosine lobe, 0 where they do not end on one."""
        chance = np.where(triangle >= 0, self._chance[triangle], 0)
        toward = np.abs((direction * self.mesh.normals[triangle]).sum(axis=1))
        density = chance * np.where(chance > 0, distance, 0) ** 2 / np.maximum(toward, 1e-6)
        return np.where(chance > 0, np.pi * density / np.maximum(cos, 1e-6), 0)

    def _aimed(
        self, position: np.ndarray, normal: np.ndarray, aimed: int, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """(N, 3) irradiance over pi that ``aimed`` rays to emitters bring, beside ``count`` of the cosine lobe."""
        rays = len(position) * aimed
        chosen = self.emitters[np.searchsorted(self._upto, rng.random(rays) * self._upto[-1], side="right")]
        odds, radiance = self._toward(position, normal, chosen, rng)
        # of cosine lobe to all, times 1 / density
        share = np.where(odds > 0, aimed / (count + aimed * odds), 0)
        return (share[:, None] * radiance).reshape(len(position), aimed, 3).mean(axis=1)

    def straight(self, position: np.ndarray, normal: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
        """(N, 3) irradiance over pi that comes straight from emitting triangles, by ``count`` rays to them each."""
        rng = np.random.default_rng(3)
        rows = np.flatnonzero(np.isin(self.emitters, triangles))
        power = np.diff(self._upto, prepend=0)[rows]
        if power.sum() <= 0:
            return np.zeros(position.shape)
        chosen = self.emitters[rng.choice(rows, len(position) * count, p=power / power.sum())]
        odds, radiance = self._toward(position, normal, chosen, rng)
        odds *= self._upto[-1] / power.sum()  # these rays are this much denser
        share = np.where(odds > 0, 1 / np.maximum(odds, _LEAST_ODDS), 0)
        return (share[:, None] * radiance).reshape(len(position), count, 3).mean(axis=1)

    def _toward(
        self, position: np.ndarray, normal: np.ndarray, chosen: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rays to points of ``chosen`` emitting triangles (R,), as many from each position.

        Their odds (`_odds`), 0 where something is between, and the radiance (R, 3) that comes along.
        """
        each = len(chosen) // len(position)
        p, n = np.repeat(position, each, axis=0), np.repeat(normal, each, axis=0)
        points = points_of(self.mesh.corners[chosen], *rng.random((2, len(p))))
        origin = (p + self.scene.epsilon * n).astype(np.float32)
        away = points - origin
        distance = np.linalg.norm(away, axis=1)
        direction = (away / np.maximum(distance, 1e-9)[:, None]).astype(np.float32)
        cos = (direction * n).sum(axis=1)
        met, triangle = self.scene.intersect(origin, direction)
        free = (cos > 0) & ((triangle == chosen) | (met >= distance * (1 - 1e-3)))
        return free * self._odds(direction, cos, distance, chosen), self._emitted(chosen, -direction)

    def _found(
        self, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray, triangle: np.ndarray, noted: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) radiance of each ray, 0 where it is not known, and whether it is lost outside. Counts if ``noted``."""
        met = triangle >= 0
        radiance = np.zeros((len(origin), 3))
        unseen = np.flatnonzero(met & self.hidden[triangle])
        side = 1 - self.mesh.front(triangle[unseen], -direction[unseen])
        radiance[unseen] = self._as_surface(self.beyond[triangle[unseen], side])
        unknown = unseen[np.isnan(radiance[unseen, 0])]
        radiance[unknown] = 0
        if noted:
            self.met += np.bincount(triangle[met], minlength=len(self.met))
            self.black += np.bincount(triangle[unknown], minlength=len(self.met))
        surface = np.flatnonzero(met & ~self.hidden[triangle])
        normal = self.mesh.normals[triangle[surface]]
        normal = np.where((normal * direction[surface]).sum(axis=1, keepdims=True) > 0, -normal, normal)
        place = origin[surface] + distance[surface, None] * direction[surface]
        own = self._emitted(triangle[surface], -direction[surface])
        measured = self._as_surface(self._seen.at(place, normal))
        radiance[surface] = np.where(np.isnan(own), measured, own)
        if self.environment.known:
            radiance[~met] = self.environment.lookup(direction[~met])
        return radiance, ~met & (not self.environment.known)

    def _as_surface(self, radiance: np.ndarray) -> np.ndarray:
        """Radiance (N, 3) that is no brighter than `brightest`."""
        return radiance * np.minimum(self.brightest / np.maximum(radiance.mean(axis=1, keepdims=True), 1e-12), 1)

    def _emitted(self, triangle: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(N, 3) radiance that triangles (N,) emit along directions (N, 3); NaN where they are of no emitter."""
        result, sides = self.emitted[triangle], self.sides[triangle]
        emitters = np.flatnonzero(sides)
        front = self.mesh.front(triangle[emitters], direction[emitters])
        result[emitters[~emits(sides[emitters], front)]] = 0
        return result

    def given(
        self, patches: Patches, position: np.ndarray, normal: np.ndarray, count: int = _PATCH_POINTS
    ) -> np.ndarray:
        """(N, P) irradiance over pi at points (N, 3) for each unit of radiance of a patch, by rays to points of it.

        Small patches would be missed by rays that are drawn from the surface.
        """
        points, normals = _patch_points(self.mesh, patches, count)
        result = np.zeros((len(position), len(patches.area)))
        origin = position + self.scene.epsilon * normal
        for k in range(points.shape[1]):
            for first in range(0, len(position), 4096):
                rows = slice(first, first + 4096)
                away = points[None, :, k] - origin[rows, None]
                distance2 = (away**2).sum(axis=-1)
                distance = np.sqrt(distance2)
                direction = away / distance[..., None]
                cos = np.clip(np.einsum("npc,nc->np", direction, normal[rows]), 0, None)
                cos_patch = np.abs(np.einsum("npc,pc->np", direction, normals[:, k]))
                # a disc seen from along its axis: right far away, and never above 1
                share = cos * cos_patch * patches.area / (np.pi * distance2 + patches.area)
                row, column = np.nonzero(share > 1e-5)
                if len(row) == 0:  # Dr.Jit traces no empty bundle
                    continue
                met, _ = self.scene.intersect(
                    np.ascontiguousarray(origin[rows][row], np.float32),
                    np.ascontiguousarray(direction[row, column], np.float32),
                )
                free = met >= distance[row, column] * (1 - 1e-3) - 2 * self.scene.epsilon
                result[first + row[free], column[free]] += share[row[free], column[free]] / points.shape[1]
        return result


def _patch_points(mesh: Mesh, patches: Patches, points_each: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points (P, K, 3) float32 of every patch, K of each by area, and the normals (P, K, 3) there."""
    rng = np.random.default_rng(1)
    count = len(patches.area)
    triangles = np.flatnonzero(patches.number >= 0)
    triangles = triangles[np.argsort(patches.number[triangles], kind="stable")]
    total = np.cumsum(mesh.areas[triangles])
    edges = np.searchsorted(patches.number[triangles], np.arange(count + 1))
    before = np.concatenate([[0.0], total])[edges]
    u = (np.arange(points_each) + rng.random((count, points_each))) / points_each
    at = before[:-1, None] + u * (before[1:] - before[:-1])[:, None]
    pick = np.minimum(np.searchsorted(total, at), edges[1:, None] - 1)
    chosen = triangles[pick]
    points = points_of(mesh.corners[chosen], *rng.random((2, *chosen.shape)))
    return points.astype(np.float32), mesh.normals[chosen]


def seen_light(blocks: Blocks, lights: Lights) -> Transport:
    """Trace the measured light of the blocks, by rays of the cosine lobe."""
    rows, points = blocks.position.shape[:2]
    flat = blocks.position.reshape(-1, 3), blocks.normal.reshape(-1, 3)
    known, outside = lights.arriving(*flat, _RAYS // points)
    return Transport.without(known.reshape(rows, points, 3).mean(axis=1), outside.reshape(rows, points).mean(axis=1))


def with_patches(blocks: Blocks, patches: Patches, lights: Lights, known: Transport) -> Transport:
    """Add to the measured light what patches reflect of it, and what each would give; rays go to points of them."""
    given = _given(blocks, patches, lights, _TOWARDS, _PATCH_POINTS)
    small = patches.of_small_parts
    given[:, small] = _given(blocks, patches.only(small, lights.mesh), lights, _TOWARDS, _SMALL_POINTS)
    at_patches, among = _among(patches, lights)
    # radiosity of unseen surface: what it sends back of seen light, and of its own; what is known has sent it already
    grey = GREY * patches.share_of(lights.black, lights.met)[:, None]
    solved = np.linalg.inv(np.eye(len(among)) - grey * among)
    reflected = solved @ (grey * at_patches)
    return Transport(known.seen + given @ reflected, given @ solved, given, known.open)


def with_more_rays(blocks: Blocks, patches: Patches, lights: Lights, transport: Transport) -> Transport:
    """The same, of what the patches give measured by many more rays, and by paths: for a few patches that emit."""
    given = _given(blocks, patches, lights, blocks.position.shape[1], _MORE_POINTS)
    return replace(transport, unseen=given + _by_unseen(blocks, patches, lights), straight=given)


def _by_unseen(blocks: Blocks, patches: Patches, lights: Lights) -> np.ndarray:
    """(N, P) what patches give by way of unseen surface: paths go on from there, as from grey.

    A shade sends on what its bulb gives to it; its cell of the unseen surface is much larger than it.
    """
    rows, points = blocks.position.shape[:2]
    count, rng, result = _RAYS // points, np.random.default_rng(2), np.zeros((rows, len(patches.area)))
    of_patch = _PATCH_POINTS if len(patches.area) <= _FEW_PATCHES else 1
    chunk = max(_PATHS // (points * count), 1)
    dark = lights.hidden & (2 * lights.black >= lights.met) & (patches.number < 0)
    for first in range(0, rows, chunk):
        here = slice(first, first + chunk)
        row = np.repeat(np.arange(rows)[here], points * count)
        position = np.repeat(blocks.position[here].reshape(-1, 3), count, axis=0)
        normal = np.repeat(blocks.normal[here].reshape(-1, 3), count, axis=0)
        for bounce in range(_BOUNCES):
            direction = cosine_directions(normal, rng)
            distance, triangle = lights.scene.intersect(position + lights.scene.epsilon * normal, direction)
            # what emits sends nothing on
            on = np.flatnonzero((triangle >= 0) & dark[triangle])
            if len(on) == 0:
                break
            position = (position[on] + distance[on, None] * direction[on]).astype(np.float32)
            normal, row = lights.mesh.normals[triangle[on]], row[on]
            normal = np.where((normal * direction[on]).sum(axis=1, keepdims=True) > 0, -normal, normal)
            given = lights.given(patches, position, normal, of_patch)
            given *= GREY ** (bounce + 1) / (count * points)
            np.add.at(result, row, given)
    return result


def _given(blocks: Blocks, patches: Patches, lights: Lights, places: int, points: int) -> np.ndarray:
    """(N, P) what patches give straight, as a mean over so many ``places`` of each block."""
    flat = blocks.position[:, :places].reshape(-1, 3), blocks.normal[:, :places].reshape(-1, 3)
    return lights.given(patches, *flat, points).reshape(len(blocks.position), places, -1).mean(axis=1)


def _among(patches: Patches, lights: Lights) -> tuple[np.ndarray, np.ndarray]:
    """What arrives at the patches: (P, 3) of what is known, and (P, P) for each unit of radiance of another patch.

    A patch faces to where light can come from: of its two sides the one that sees more of the seen surface.
    """
    points, normals = _patch_points(lights.mesh, patches, _PATCH_POINTS)
    count, per = points.shape[:2]
    sides = []
    for turn in (1, -1):
        flat = points.reshape(-1, 3), (turn * normals).reshape(-1, 3).astype(np.float32)
        known, _ = lights.arriving(*flat, 64, noted=False)
        given = lights.given(patches, *flat)
        sides.append((known.reshape(count, per, 3).mean(axis=1), given.reshape(count, per, count).mean(axis=1)))
    better = sides[0][0].mean(axis=1) >= sides[1][0].mean(axis=1)
    known, given = (np.where(better[:, None], a, b) for a, b in zip(*sides, strict=True))
    np.fill_diagonal(given, 0)
    # rounding of the estimate must not make light out of nothing
    return known, given / np.maximum(given.sum(axis=1, keepdims=True), 1.0)
