"""The path tracer: the factorised shading integrals of footprint samples, in one fused kernel.

    Ld     = integral of Li (n.i) / pi
    Ls0(s) = integral of Li (1 - Fc) D G / 4 (n.i)        Ls1(s) = integral of Li Fc D G / 4 (n.i)

Legend, in the symbols of the paper and of Mitsuba's `prb.py`:

    x   point that is shaded, depth 0: a footprint sample, or one of its points
    N   directions drawn at x
    y   later vertex of a path, depth 1, 2, ...           v   vertex where a path is: x or y
    n   unit normal, turned to where one comes from       i, o   to the light, to the viewer (wi, wo)
    f   reflectance of v times (n.i)                      L   radiance that comes back to x from i
    β   share of the light at v that reaches x            Le, Li   emitted, incoming radiance
    p   density of a direction at v, per steradian: of the lobes times N at x, of the material's lobes at y
    ds  sample of a point on an emitter: its direction wi, its density p per steradian, its radiance Le
    si  where a ray meets the mesh: y, the normal there, the triangle
"""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render import ggx
from fipt.render.environment import Sky
from fipt.render.lobes import LobeMixture
from fipt.render.points import Points
from fipt.render.scene import RayScene, lanes, vectors
from fipt.render.spots import Spot
from fipt.render.surface import SurfaceCache, Triangles

_ROULETTE = 6
"""Bounces after which paths that carry little end by chance (Arvo and Kirk 1990): in a white room a twentieth of the
light has bounced more often, and no picture needs all of these paths."""
_MOST_SURVIVE = 0.95
"""Of those paths, at each bounce."""


@dataclass(frozen=True)
class PathSettings:
    """How paths go on: ``max_depth`` bounces at most; vertices rougher than ``cache_roughness`` end in
    the cache where it knows them; ``light_at_first`` samples emitters at the first hit too.
    """

    max_depth: int
    cache_roughness: float
    light_at_first: bool


@dataclass
class Vertex:
    """A vertex of paths, one a lane: where they are, and the material there (unused at x).

    Attributes
    ----------
    p, n, wo
        Place (metres), normal turned to the viewer, direction to the viewer (of y: to the vertex before).
    base_color, s, metallic
        The material: base colour, roughness, metallic.
    """

    p: "mi.Point3f"
    n: "mi.Vector3f"
    wo: "mi.Vector3f"
    base_color: "mi.Color3f"
    s: "mi.Float"
    metallic: "mi.Float"

    def evaluate(self, wi: "mi.Vector3f") -> tuple["mi.Color3f", "mi.Float"]:
        """f, and the density with which `Shader._next_direction` draws ``wi``."""
        return ggx.evaluate(ggx.ReflectionGeometry(self.n, wi, self.wo), self.base_color, self.s, self.metallic)


@dataclass
class Interaction:
    """Where rays meet the mesh.

    Attributes
    ----------
    valid, leaves
        Whether the ray meets the mesh, or leaves it; neither where no ray was traced.
    p, t
        Place and distance, metres.
    wi
        Direction of the ray.
    normal, n, cos
        Normal by winding order; turned against the ray; cosine of the first with the ray.
    triangle, emitter
        Number of the triangle; that of its emitter + 1, 0 where it does not emit.
    """

    valid: "mi.Bool"
    leaves: "mi.Bool"
    p: "mi.Point3f"
    t: "mi.Float"
    wi: "mi.Vector3f"
    normal: "mi.Vector3f"
    n: "mi.Vector3f"
    cos: "mi.Float"
    triangle: "mi.UInt32"
    emitter: "mi.UInt32"


@dataclass
class Arrival:
    """What paths find where their rays meet something.

    Attributes
    ----------
    radiance
        Emitted or cached radiance that is sent back along the ray.
    p_emitter
        Density (per steradian) with which emitters or the sun are sampled here; 0 where they cannot be.
    ends
        Whether the path ends here.
    record, s
        The cache's record of the place, and its roughness.
    """

    radiance: "mi.Color3f"
    p_emitter: "mi.Float"
    ends: "mi.Bool"
    record: "mi.UInt32"
    s: "mi.Float"


class Shader:
    """Estimates the shading integrals at points.

    Parameters
    ----------
    scene
        What rays are traced against.
    triangles
        Normals and emitters.
    cache
        Radiance (and materials) of the surface.
    path
        None in round 0, where the first vertex ends in the cache; else how paths go on.
    sky
        Radiance of rays that leave the mesh; None: zero.
    spots
        Lights at points, which paths see by shadow rays alone; only where ``path`` says how paths go on.
    """

    def __init__(
        self,
        scene: RayScene,
        triangles: Triangles,
        cache: SurfaceCache,
        path: PathSettings | None,
        sky: Sky | None = None,
        spots: Sequence[Spot] = (),
    ) -> None:
        self.scene, self.triangles, self.cache, self.path, self.sky = scene, triangles, cache, path, sky
        self.spots = spots
        self._samples_emitters = path is not None and triangles.has_emitters
        self._emitters_at_x = path is not None and path.light_at_first and triangles.has_emitters
        self._samples_sun = sky is not None and sky.suns > 0
        self._some_end_by_chance = path is not None and path.max_depth > _ROULETTE

    def shade(
        self, points: Points, levels: Sequence[float | np.ndarray], counts: Sequence[int], per_sample: int = 1
    ) -> np.ndarray:
        """Estimate Ld, Ls0 and Ls1 of every level.

        Parameters
        ----------
        levels
            Roughness of each specular level: a number, or (N,) values.
        counts
            Directions drawn from the cosine lobe and from each level's GGX lobe.
        per_sample
            So many consecutive points, which have one key, make one sample: they share its directions, and the result
            is their mean. It divides ``counts``.

        Returns
        -------
        (N / per_sample, 1 + 2 len(levels), 3) float32: Ld, then Ls0 of every level, then Ls1 of every level.
        """
        p, n = vectors(points.position, mi.Point3f), vectors(points.normal, mi.Vector3f)
        wo, key = vectors(points.wo, mi.Vector3f), lanes(points.key, mi.UInt64)
        x = Vertex(p, n, wo, mi.Color3f(0.0), mi.Float(1.0), mi.Float(0.0))
        assert not any(count % per_sample for count in counts), (
            f"{per_sample} points share the directions {list(counts)}"
        )
        point = lanes(np.arange(len(points.key), dtype=np.uint32) % np.uint32(per_sample), mi.UInt32)
        integrals = self._kernel(x, key, point, LobeMixture(levels, [count // per_sample for count in counts]))
        dr.eval(integrals)
        result = np.stack([np.array(value).T for value in integrals], axis=1)
        return result if per_sample == 1 else result.reshape(-1, per_sample, *result.shape[1:]).mean(axis=1)

    @dr.syntax
    def _kernel(self, x: Vertex, key: "mi.UInt64", point: "mi.UInt32", lobes: LobeMixture) -> list["mi.Color3f"]:
        """One lane = one x. One loop for directions and bounces: where a path ends, the next direction at x begins."""
        # points of a sample share the shift of their directions; all other random numbers are a point's own
        # no size: it would number the streams by lane, and results would depend on chunks
        shared = mi.PCG32(initstate=key, initseq=dr.zeros(mi.UInt64, dr.width(x.p)))
        shift = shared.next_float32(), shared.next_float32()
        rng = mi.PCG32(initstate=key, initseq=mi.UInt64(point) + 1)
        frame = mi.Frame3f(x.n)
        integrals = [dr.zeros(mi.Color3f, dr.width(x.p)) for _ in range(lobes.outputs)]

        k = mi.UInt32(0)  # number of the direction at x
        depth = mi.UInt32(0)  # of v
        v = dr.copy(x)  # where the path is
        β = mi.Color3f(1.0)  # its throughput
        L = mi.Color3f(0.0)  # radiance it has found
        wi_x = mi.Vector3f(0, 0, 1)  # direction at x in which it left
        p_emitter_x = mi.Float(0.0)  # density with which emitter sampling at x draws what lies there, times N

        while k < lobes.total:
            at_x = depth == 0

            # ---------------- emitters, sampled at v (next-event estimation) ----------------
            L += self._emitter_light(rng, v, β, at_x, lobes, integrals)
            if dr.hint(len(self.spots) > 0, mode="scalar"):
                L += self._spot_light(v, β, at_x, k == 0, lobes, integrals)
            if dr.hint(self._samples_sun, mode="scalar"):
                L += self._sunlight(rng, v, β, at_x, lobes, integrals)

            # ---------------- a new direction: of the lobes at x, of the material at y ----------------
            wi = lobes.sample(k, point, shift, frame, x.wo)
            p = mi.Float(0.0)
            if dr.hint(self.path is not None, mode="scalar"):
                wi = dr.select(at_x, wi, self._next_direction(rng, v))
                f, p = v.evaluate(wi)
                β = dr.select(at_x, 1.0, β * dr.select(p > 0, f / p, 0))
                if dr.hint(self._some_end_by_chance, mode="scalar"):
                    β = self._survivors(rng, β, depth)
            wi_x = dr.select(at_x, wi, wi_x)

            # ---------------- what lies there: emission, cache, environment ----------------
            si = self._intersect(v, wi, (dr.dot(v.n, wi) > 0) & (dr.max(β) > 0))
            found = self._arrive(si, depth)
            by_both = found.p_emitter > 0
            # MIS: balance heuristic over the N lobe and N emitter samples at x (below), power heuristic at y
            mis = dr.select(by_both & ~at_x, dr.square(p) / (dr.square(p) + dr.square(found.p_emitter)), 1)
            L += β * found.radiance * mis
            if dr.hint(self._emitters_at_x or self._samples_sun, mode="scalar"):
                p_emitter = dr.select(by_both, found.p_emitter * mi.Float(lobes.total), 0)
                p_emitter_x = dr.select(at_x, p_emitter, p_emitter_x)

            # ---------------- the path ends: L counts for all integrals; or it goes on at y ----------------
            g = ggx.ReflectionGeometry(x.n, wi_x, x.wo)
            density = lobes.density(g) + p_emitter_x
            lobes.splat(integrals, g, dr.select(found.ends & (density > 1e-12), L / density, 0))
            v = dr.select(found.ends, x, self._vertex(si, found))
            L = dr.select(found.ends, 0, L)
            k, depth = dr.select(found.ends, k + 1, k), dr.select(found.ends, 0, depth + 1)
        return integrals

    def _emitter_light(
        self,
        rng: "mi.PCG32",
        v: Vertex,
        β: "mi.Color3f",
        at_x: "mi.Bool",
        lobes: LobeMixture,
        integrals: list["mi.Color3f"],
    ) -> "mi.Color3f":
        """Light of one point on an emitter at v: what a path gains at y. At x all integrals get it instead."""
        if not self._samples_emitters:
            return mi.Color3f(0.0)
        wanted = mi.Bool(True) if self._emitters_at_x else ~at_x
        ds = self.triangles.sample(rng.next_float32(), rng.next_float32(), rng.next_float32(), wanted)
        origin = self._origin(v)
        away = ds.p - origin
        distance2 = dr.squared_norm(away)
        distance = dr.sqrt(distance2)
        wi = away / distance
        toward = dr.dot(ds.n, -wi)
        cos = dr.abs(toward)
        p_emitter = ds.p_area * distance2 / cos
        visible = wanted & (dr.dot(v.n, wi) > 0) & (cos > 1e-6) & self.triangles.emits(ds.emitter, toward, wanted)
        visible &= ~self._blocked(origin, wi, distance * (1 - 1e-3) - self.scene.offset(v.p), visible)
        if self._emitters_at_x:
            g = ggx.ReflectionGeometry(v.n, wi, v.wo)
            density = lobes.density(g) + dr.select(visible, p_emitter, 0) * mi.Float(lobes.total)
            lobes.splat(integrals, g, dr.select(visible & at_x & (density > 0), ds.radiance / density, 0))
        f, p = v.evaluate(wi)
        mis = dr.square(p_emitter) / (dr.square(p_emitter) + dr.square(p))
        return dr.select(visible & ~at_x, β * f * ds.radiance * (mis / p_emitter), 0)

    def _spot_light(
        self,
        v: Vertex,
        β: "mi.Color3f",
        at_x: "mi.Bool",
        first: "mi.Bool",
        lobes: LobeMixture,
        integrals: list["mi.Color3f"],
    ) -> "mi.Color3f":
        """Light of the spots at v: what a path gains at y. At x all integrals get it, with the ``first`` path."""
        gained = mi.Color3f(0.0)
        origin = self._origin(v)
        for spot in self.spots:
            arriving, wi, distance = spot.at(origin)
            visible = (~at_x | first) & (dr.dot(v.n, wi) > 0) & (dr.max(arriving) > 0)
            visible &= ~self._blocked(origin, wi, distance * (1 - 1e-3), visible)
            g = ggx.ReflectionGeometry(v.n, wi, v.wo)
            lobes.splat(integrals, g, dr.select(visible & at_x, arriving, 0))
            f, _ = v.evaluate(wi)
            gained += dr.select(visible & ~at_x, β * f * arriving, 0)
        return gained

    def _sunlight(
        self,
        rng: "mi.PCG32",
        v: Vertex,
        β: "mi.Color3f",
        at_x: "mi.Bool",
        lobes: LobeMixture,
        integrals: list["mi.Color3f"],
    ) -> "mi.Color3f":
        """Light of one point of the sun at v: what a path gains at y. At x all integrals get it instead."""
        assert self.sky is not None
        wi, p_sun = self.sky.sample_sun(rng.next_float32(), rng.next_float32(), rng.next_float32())
        visible = dr.dot(v.n, wi) > 0
        visible &= ~self._blocked(self._origin(v), wi, mi.Float(dr.largest(mi.Float)), visible)
        Le, _ = self.sky.lookup(wi, visible)
        g = ggx.ReflectionGeometry(v.n, wi, v.wo)
        density = lobes.density(g) + p_sun * mi.Float(lobes.total)
        lobes.splat(integrals, g, dr.select(visible & at_x, Le / density, 0))
        f, p = v.evaluate(wi)
        mis = dr.square(p_sun) / (dr.square(p_sun) + dr.square(p))
        return dr.select(visible & ~at_x, β * f * Le * (mis / p_sun), 0)

    @staticmethod
    def _survivors(rng: "mi.PCG32", β: "mi.Color3f", depth: "mi.UInt32") -> "mi.Color3f":
        """Throughput of long paths of which dim ones end by chance, the others being as much brighter."""
        chance = dr.select(depth >= _ROULETTE, dr.minimum(dr.max(β), _MOST_SURVIVE), 1)
        return dr.select(rng.next_float32() < chance, β / chance, 0)

    @staticmethod
    def _next_direction(rng: "mi.PCG32", v: Vertex) -> "mi.Vector3f":
        """Direction at y: half the time from the cosine lobe, half from its GGX lobe."""
        choice, u1, u2 = rng.next_float32(), rng.next_float32(), rng.next_float32()
        frame = mi.Frame3f(v.n)
        h = frame.to_world(ggx.sample_half_vector(u1, u2, dr.square(v.s)))
        return dr.select(choice < 0.5, frame.to_world(ggx.sample_cosine(u1, u2)), ggx.mirrored(v.wo, h))

    def _intersect(self, v: Vertex, wi: "mi.Vector3f", active: "mi.Bool") -> Interaction:
        """Trace rays from v."""
        ray = mi.Ray3f(self._origin(v), wi)
        found = self.scene.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        valid = active & found.is_valid()
        normal, emitter = self.triangles.lookup(found.prim_index, valid)
        cos = dr.dot(normal, wi)
        n = dr.select(cos > 0, -normal, normal)
        leaves = active & ~valid
        return Interaction(valid, leaves, ray(found.t), found.t, wi, normal, n, cos, found.prim_index, emitter)

    def _arrive(self, si: Interaction, depth: "mi.UInt32") -> Arrival:
        """Le of an emitter first; then the cache, where the path may end in it; then the environment."""
        if self.path is None:
            record = self.cache.find(si.p, si.n, si.valid)
            radiance, s, _ = self.cache.lookup_radiance(record, si.valid)
            radiance, p_emitter = self._or_environment(dr.select(si.valid, radiance, 0), mi.Float(0.0), si)
            return Arrival(radiance, p_emitter, mi.Bool(True), record, s)
        radiance, p_emitter, ends = mi.Color3f(0.0), mi.Float(0.0), ~si.valid
        if self.triangles.absorb:
            on_emitter = si.valid & (si.emitter > 0)
            emits = on_emitter & self.triangles.emits(si.emitter - 1, -si.cos, on_emitter)
            Le, p_area = self.triangles.radiance(si.emitter - 1, emits)
            radiance = dr.select(emits, Le, radiance)
            p_emitter = dr.select(emits, p_area * dr.square(si.t) / dr.maximum(dr.abs(si.cos), 1e-6), 0)
            if not self.path.light_at_first:
                p_emitter = dr.select(depth == 0, 0, p_emitter)
            ends |= on_emitter
        record = self.cache.find(si.p, si.n, ~ends, si.triangle)
        cached, s, known = self.cache.lookup_radiance(record, ~ends)
        last = depth + 1 >= self.path.max_depth
        read = ~ends & known & ((s > self.path.cache_roughness) | last)
        radiance, p_emitter = self._or_environment(dr.select(read, cached, radiance), p_emitter, si)
        return Arrival(radiance, p_emitter, ends | read | last, record, s)

    def _vertex(self, si: Interaction, found: Arrival) -> Vertex:
        """The place a path has come to, with its material, as its next vertex."""
        base_color, metallic = mi.Color3f(0.0), mi.Float(0.0)
        if self.path is not None:
            base_color, metallic = self.cache.lookup_material(found.record, ~found.ends)
        return Vertex(si.p, si.n, -si.wi, base_color, found.s, metallic)

    def _or_environment(
        self, radiance: "mi.Color3f", p_emitter: "mi.Float", si: Interaction
    ) -> tuple["mi.Color3f", "mi.Float"]:
        """``radiance`` and ``p_emitter``, or those of the environment where a ray leaves the mesh."""
        if self.sky is None:
            return radiance, p_emitter
        outside, p_sun = self.sky.lookup(si.wi, si.leaves)
        return dr.select(si.leaves, outside, radiance), dr.select(si.leaves, p_sun, p_emitter)

    def _blocked(self, origin: "mi.Point3f", wi: "mi.Vector3f", distance: "mi.Float", active: "mi.Bool") -> "mi.Bool":
        """Whether something lies between a point and another ``distance`` away."""
        return self.scene.scene.ray_test(mi.Ray3f(origin, wi, distance, 0.0, []), active=active)

    def _origin(self, v: Vertex) -> "mi.Point3f":
        """Where rays from v start: a little above the surface."""
        return v.p + v.n * self.scene.offset(v.p)
