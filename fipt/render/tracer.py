"""The path tracer: the factorised shading integrals of footprint samples, in one fused kernel.

Legend: x first hit, y later vertices, n normal, wi direction to the light, wo to the viewer, N lobe samples a hit,
p density of the lobe mixture times N (samples per steradian), q density of choosing a point on an emitter.

    Ld     = integral of Li (n.i) / pi
    Ls0(s) = integral of Li (1 - Fc) D G / 4 (n.i)        Ls1(s) = integral of Li Fc D G / 4 (n.i)

One set of directions, drawn from a cosine lobe and GGX lobes, serves all of these through the balance heuristic
(Veach 1997); drawing from one lobe at a time, as the paper does, is the special case of one non-zero count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render import ggx
from fipt.render.environment import Sky
from fipt.render.scene import RayScene, lanes, vectors
from fipt.render.spots import Spot
from fipt.render.surface import SurfaceCache, Triangles

_R2 = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 low-discrepancy sequence (Roberts 2018)."""


@dataclass(frozen=True)
class Points:
    """Footprint samples to shade: (N, 3) position (metres), unit normal, unit direction to the viewer; (N,) uint64 key
    of their random numbers.
    """

    position: np.ndarray
    normal: np.ndarray
    wo: np.ndarray
    key: np.ndarray


@dataclass(frozen=True)
class PathSettings:
    """How paths go on: ``max_depth`` vertices after the first hit; vertices rougher than ``cache_roughness`` end in
    the cache where it knows them; ``light_at_first`` samples emitters at the first hit too.
    """

    max_depth: int
    cache_roughness: float
    light_at_first: bool


def random_keys(view: str, pixel: np.ndarray, piece: np.ndarray, seed: int) -> np.ndarray:
    """(N,) uint64 keys that depend on view, pixel, piece (below 256) and seed only: results do not depend on shards."""
    from hashlib import blake2b

    base = int.from_bytes(blake2b(f"{seed}/{view}".encode(), digest_size=8).digest(), "little")
    x = (pixel.astype(np.uint64) * np.uint64(256) + piece.astype(np.uint64)) ^ np.uint64(base)
    with np.errstate(over="ignore"):  # splitmix64, modulo 2^64
        x = x + np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


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

    def shade(self, points: Points, levels: Sequence[float | np.ndarray], counts: Sequence[int]) -> np.ndarray:
        """Estimate Ld, Ls0 and Ls1 of every level.

        Parameters
        ----------
        levels
            Roughness of each specular level: a number, or (N,) values.
        counts
            Directions drawn from the cosine lobe and from each level's GGX lobe.

        Returns
        -------
        (N, 1 + 2 len(levels), 3) float32: Ld, then Ls0 of every level, then Ls1 of every level.
        """
        p, n = vectors(points.position, mi.Point3f), vectors(points.normal, mi.Vector3f)
        wo, key = vectors(points.wo, mi.Vector3f), lanes(points.key, mi.UInt64)
        roughness = [lanes(level, mi.Float) if np.ndim(level) else float(level) for level in levels]
        cumulated = [mi.UInt32(int(c)) for c in np.cumsum(counts)]
        weights = [mi.Float(float(c)) for c in counts]
        dr.make_opaque(cumulated, weights)  # literals would compile a kernel for every sample count
        used = [count > 0 for count in counts]
        sums = self._kernel(p, n, wo, key, roughness, cumulated, weights, used)
        dr.eval(sums)
        return np.stack([np.array(value).T for value in sums], axis=1)

    @dr.syntax
    def _kernel(self, p0, n0, wo0, key, roughness, cumulated, weights, used):
        """One lane = one hit; samples and bounces in one loop: a lane whose path ends starts its next sample."""
        width = dr.width(p0)
        # no size: it would number the streams by lane, and results would depend on chunks
        rng = mi.PCG32(initstate=key, initseq=dr.zeros(mi.UInt64, width))
        shift1, shift2 = rng.next_float32(), rng.next_float32()
        frame0 = mi.Frame3f(n0)
        total = cumulated[-1]
        sums = [dr.zeros(mi.Color3f, width) for _ in range(1 + 2 * len(roughness))]

        sample = mi.UInt32(0)
        depth = mi.UInt32(0)
        p, n, wo = mi.Point3f(p0), mi.Vector3f(n0), mi.Vector3f(wo0)
        base, s, metallic = (
            mi.Color3f(0.0),
            mi.Float(1.0),
            mi.Float(0.0),
        )  # material at p, used from depth 1 on
        throughput, L = mi.Color3f(1.0), mi.Color3f(0.0)
        wi_first, light_first = mi.Vector3f(0, 0, 1), mi.Float(0.0)

        while sample < total:
            first = depth == 0
            origin = p + n * self.scene.epsilon

            # -- light sampling at p (next-event estimation)
            light, wl, pl = self._sample_light(rng, origin, p, n, wo, base, s, metallic, throughput, first)
            if dr.hint(self._lights_first(), mode="scalar"):
                g = ggx.Geometry(n, wl, wo)
                density = self._density(g, roughness, weights, used) + pl * mi.Float(total)
                self._splat(sums, g, roughness, dr.select(first & (density > 0), light / density, 0))
            L += dr.select(first, 0, light)
            if dr.hint(len(self.spots) > 0, mode="scalar"):
                L += self._spots(sums, sample, origin, n, wo, base, s, metallic, throughput, first, roughness)

            # -- a new direction: from the lobe mixture at x, from the material at y
            wi = self._first_direction(sample, shift1, shift2, frame0, wo, roughness, cumulated)
            if dr.hint(self.path is not None, mode="scalar"):
                wi_next = self._next_direction(rng, n, wo, s)
                wi = dr.select(first, wi, wi_next)
            p_y = mi.Float(0.0)
            if dr.hint(self.path is not None, mode="scalar"):
                value, p_y = ggx.evaluate(ggx.Geometry(n, wi, wo), base, s, metallic)
                throughput = dr.select(first, 1.0, throughput * dr.select(p_y > 0, value / p_y, 0))
            wi_first = dr.select(first, wi, wi_first)
            alive = (dr.dot(n, wi) > 0) & (dr.max(throughput) > 0)

            # -- what it finds
            ray = mi.Ray3f(origin, wi)
            found = self.scene.scene.ray_intersect_preliminary(ray, coherent=False, active=alive)
            on_mesh = alive & found.is_valid()
            y = ray(found.t)
            n_y, emitter = self.triangles.lookup(found.prim_index, on_mesh)
            facing = dr.dot(n_y, wi)
            n_facing = dr.select(facing > 0, -n_y, n_y)
            out, stop, p_light, record, s_y = self._arrive(
                y, wi, n_y, facing, emitter, on_mesh, alive, found.t, depth, found.prim_index
            )
            lit = on_mesh & (p_light > 0)
            # MIS: balance heuristic over the N lobe and N light samples at x, power heuristic later
            mis = dr.select(lit & ~first, dr.square(p_y) / (dr.square(p_y) + dr.square(p_light)), 1)
            L += throughput * out * mis
            if dr.hint(self._lights_first(), mode="scalar"):
                light_first = dr.select(first, dr.select(lit, p_light * mi.Float(total), 0), light_first)

            # -- end of a path: add it to all integrals; or go on
            done = stop | ~alive
            g = ggx.Geometry(n0, wi_first, wo0)
            p_first = self._density(g, roughness, weights, used) + light_first
            self._splat(sums, g, roughness, dr.select(done & (p_first > 1e-12), L / p_first, 0))
            if dr.hint(self.path is not None, mode="scalar"):
                base_y, metallic_y = self.cache.lookup_material(record, ~done)
                base, s, metallic = base_y, s_y, metallic_y
            p, n = dr.select(done, p0, y), dr.select(done, n0, n_facing)
            wo = dr.select(done, wo0, -wi)
            L = dr.select(done, 0, L)
            sample, depth = dr.select(done, sample + 1, sample), dr.select(done, 0, depth + 1)
        return sums

    def _lights_first(self) -> bool:
        return self.path is not None and self.path.light_at_first and self.triangles.has_emitters

    def _density(self, g, roughness, weights, used):
        """Samples per steradian of the lobe mixture along g's direction."""
        density = weights[0] * g.pdf_cosine()
        for s, weight, drawn in zip(roughness, weights[1:], used[1:], strict=True):
            if drawn:
                density = dr.fma(weight, g.pdf_ggx(dr.square(s)), density)
        return density

    @staticmethod
    def _splat(sums, g, roughness, value) -> None:
        """Add ``value`` (radiance over sample density) times each integrand's weight to the sums, in place."""
        fc = ggx.schlick(g.oh)
        sums[0] += value * (g.ni * dr.inv_pi)
        for level, s in enumerate(roughness):
            lobe = value * g.specular(s)
            sums[1 + level] += lobe * (1 - fc)
            sums[1 + len(roughness) + level] += lobe * fc

    @staticmethod
    def _first_direction(sample, shift1, shift2, frame, wo, roughness, cumulated):
        """Direction number ``sample`` at x: stratified over the lobes, low-discrepancy within each."""
        start, alpha = mi.UInt32(0), mi.Float(1.0)
        for s, low, high in zip(roughness, cumulated[:-1], cumulated[1:], strict=True):
            inside = (sample >= low) & (sample < high)
            start = dr.select(inside, low, start)
            alpha = dr.select(inside, dr.square(s), alpha)
        k = mi.Float(sample - start)
        u1, u2 = dr.fma(k, _R2[0], shift1), dr.fma(k, _R2[1], shift2)
        u1, u2 = u1 - dr.floor(u1), u2 - dr.floor(u2)
        diffuse = frame.to_world(ggx.sample_cosine(u1, u2))
        h = frame.to_world(ggx.sample_half_vector(u1, u2, alpha))
        return dr.select(sample < cumulated[0], diffuse, dr.normalize(dr.fma(2 * dr.dot(wo, h), h, -wo)))

    @staticmethod
    def _next_direction(rng, n, wo, s):
        """Direction at y: half the time from the cosine lobe, half from its GGX lobe."""
        choice, u1, u2 = rng.next_float32(), rng.next_float32(), rng.next_float32()
        frame = mi.Frame3f(n)
        h = frame.to_world(ggx.sample_half_vector(u1, u2, dr.square(s)))
        mirrored = dr.normalize(dr.fma(2 * dr.dot(wo, h), h, -wo))
        return dr.select(choice < 0.5, frame.to_world(ggx.sample_cosine(u1, u2)), mirrored)

    def _sample_light(self, rng, origin, p, n, wo, base, s, metallic, throughput, first):
        """One light sample at p. At x: emitted radiance where visible, its direction and density per steradian;
        at y: the finished contribution, MIS weight included.
        """
        if self.path is None or not self.triangles.has_emitters:
            return mi.Color3f(0.0), mi.Vector3f(0, 0, 1), mi.Float(0.0)
        wanted = mi.Bool(True) if self.path.light_at_first else ~first
        q, n_q, radiance, pdf = self.triangles.sample(
            rng.next_float32(), rng.next_float32(), rng.next_float32(), wanted
        )
        away = q - origin
        distance2 = dr.squared_norm(away)
        distance = dr.sqrt(distance2)
        wl = away / distance
        cos_q = dr.abs(dr.dot(n_q, wl))
        p_light = pdf * distance2 / cos_q
        ok = wanted & (dr.dot(n, wl) > 0) & (cos_q > 1e-6) & self.triangles.shines(n_q, -wl)
        ray = mi.Ray3f(origin, wl, distance * (1 - 1e-3) - self.scene.epsilon, 0.0, [])
        ok &= ~self.scene.scene.ray_test(ray, active=ok)
        value, p_lobe = ggx.evaluate(ggx.Geometry(n, wl, wo), base, s, metallic)
        mis = dr.square(p_light) / (dr.square(p_light) + dr.square(p_lobe))
        at_y = throughput * value * radiance * (mis / p_light)
        return dr.select(ok, dr.select(first, radiance, at_y), 0), wl, dr.select(ok, p_light, 0)

    def _spots(self, sums, sample, origin, n, wo, base, s, metallic, throughput, first, roughness):
        """Light of the spots at p. At x it is added to all integrals, once a hit; at y: what the path gains."""
        gained = mi.Color3f(0.0)
        for spot in self.spots:
            arriving, wl, distance = spot.at(origin)
            ok = (~first | (sample == 0)) & (dr.dot(n, wl) > 0) & (dr.max(arriving) > 0)
            ray = mi.Ray3f(origin, wl, distance * (1 - 1e-3), 0.0, [])
            ok &= ~self.scene.scene.ray_test(ray, active=ok)
            g = ggx.Geometry(n, wl, wo)
            self._splat(sums, g, roughness, dr.select(ok & first, arriving, 0))
            value, _ = ggx.evaluate(g, base, s, metallic)
            gained += dr.select(ok & ~first, throughput * value * arriving, 0)
        return gained

    def _arrive(self, y, wi, n_y, facing, emitter, on_mesh, alive, distance, depth, triangle):
        """Radiance that y sends back; whether the path ends there; the density (per steradian) with which light
        sampling would have chosen y (0 where it could not); the cache's record of y and its roughness.
        """
        out, p_light = mi.Color3f(0.0), mi.Float(0.0)
        normal = dr.select(facing > 0, -n_y, n_y)
        ends = ~on_mesh
        if self.path is None:
            record = self.cache.find(y, normal, on_mesh)
            radiance, s_y, _ = self.cache.lookup_radiance(record, on_mesh)
            out = self._outside(dr.select(on_mesh, radiance, 0), wi, alive & ~on_mesh)
            return out, mi.Bool(True), p_light, record, s_y
        if self.triangles.has_lamps:
            hit = on_mesh & (emitter > 0) & self.triangles.shines(n_y, -wi)
            radiance, pdf = self.triangles.radiance(emitter - 1, hit)
            out = dr.select(hit, radiance, out)
            p_light = dr.select(hit, pdf * dr.square(distance) / dr.maximum(dr.abs(facing), 1e-6), 0)
            if not self.path.light_at_first:
                p_light = dr.select(depth == 0, 0, p_light)
            ends |= on_mesh & (emitter > 0)
        record = self.cache.find(y, normal, ~ends, triangle)
        radiance, s_y, known = self.cache.lookup_radiance(record, ~ends)
        last = depth + 1 >= self.path.max_depth
        read = ~ends & known & ((s_y > self.path.cache_roughness) | last)
        out = dr.select(read, radiance, out)
        return self._outside(out, wi, alive & ~on_mesh), ends | read | last, p_light, record, s_y

    def _outside(self, out, wi, leaves):
        """``out``, and the sky's radiance where a ray leaves the mesh."""
        return out if self.sky is None else dr.select(leaves, self.sky.lookup(wi, leaves), out)
