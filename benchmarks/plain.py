"""The shading stages of the published method, written plainly: what the kernels are measured against.

A torch wavefront around Mitsuba's ray intersection. One lobe is sampled at a time, with independent random numbers;
the cache is a dense grid of voxels; light sampling picks emitting triangles uniformly, as the published code does.
The estimates agree with those of `fipt.render.tracer.Shader`, whose interface is repeated here. Where the published
code is slow by accident this is not: a call to the intersection traces its rays once, however many outputs are asked
for (`Rays` can be told otherwise), and batches are as large as is fastest.

Symbols as in `fipt.render.ggx`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import torch
from torch import Tensor

from fipt.model.networks import QUERY_CHUNK
from fipt.render.points import Points
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, Materials
from fipt.render.tracer import PathSettings
from fipt.scene.mesh import Mesh

BATCH = 1 << 19
"""Rays of a wavefront. Of 2^14 to 2^20 this or the next larger one was the fastest on two cores."""


def dot(a: Tensor, b: Tensor) -> Tensor:
    """(N, 1) inner products of (N, 3) vectors."""
    return (a * b).sum(1, keepdim=True)


# --- rays and cache -------------------------------------------------------------------------------


class Rays:
    """Mitsuba's ray intersection, tensors in and tensors out.

    Parameters
    ----------
    mesh
        What is hit.
    together
        Evaluate all outputs of a call at once. Otherwise each is converted on its own, as in the published code, and
        Dr.Jit traces the rays again for every one.
    """

    def __init__(self, mesh: Mesh, together: bool = True) -> None:
        room = RayScene(mesh)
        self.scene, self.epsilon, self.together = room.scene, room.epsilon, together

    def __call__(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Trace (N, 3) rays: (N, 3) position, (N, 3) normal by winding order, (N,) int64 triangle or -1."""
        o, d = mi.Point3f(origin.T.contiguous()), mi.Vector3f(direction.T.contiguous())
        si = self.scene.ray_intersect(mi.Ray3f(o, d))
        triangle = dr.select(si.is_valid(), mi.Int32(si.prim_index), -1)
        if self.together:
            dr.eval(si.p, si.n, triangle)
        position, normal, triangle = si.p.torch(), si.n.torch(), triangle.torch()
        dr.sync_thread()
        return position.T.contiguous(), normal.T.contiguous(), triangle.long()


class DenseCache:
    """Radiance and material of voxels, found through an index for every cell of the box.

    Parameters
    ----------
    voxels
        Arrays of cache.npz with one record a voxel, whichever way the surface faces.
    known
        (K,) bool: whether the radiance may end a path.
    materials
        Of the K records; None in round 0.
    """

    def __init__(
        self, voxels: Mapping[str, np.ndarray], known: np.ndarray, materials: Materials | None, device: str
    ) -> None:
        n, key = int(voxels["resolution"]), voxels["key"]
        index = np.full(n**3, len(key), np.int32)
        index[key] = np.arange(len(key))
        columns = [voxels["radiance"], known[:, None]]
        nothing = [0.0, 0.0, 0.0, 0.0]
        if materials is not None:
            columns += [materials.base_color, materials.roughness[:, None], materials.metallic[:, None]]
            nothing += [0.5, 0.5, 0.5, 1.0, 0.0]
        values = np.concatenate([np.concatenate(columns, axis=1), [nothing]])
        self.index = torch.from_numpy(index).to(device)
        self.values = torch.from_numpy(values.astype(np.float32)).to(device)
        low = voxels["center"] - voxels["side"] / 2
        self.low = torch.tensor(low, dtype=torch.float32, device=device)
        self.scale, self.resolution = n / float(voxels["side"]), n

    def __call__(self, p: Tensor) -> Tensor:
        """Records (N, 4 or 9) at (N, 3) points: radiance, known, base colour, roughness, metallic."""
        x, y, z = ((p - self.low) * self.scale).long().clamp_(0, self.resolution - 1).unbind(1)
        return self.values[self.index[x + self.resolution * (y + self.resolution * z)].long()]


# --- reflectance ----------------------------------------------------------------------------------


def to_world(n: Tensor, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
    """Turn (N,) coordinates in the frame of (N, 3) unit normals into world vectors (Duff et al. 2017)."""
    nx, ny, nz = n.unbind(1)
    sign = torch.where(nz >= 0, 1.0, -1.0)
    a = -1 / (sign + nz)
    b = nx * ny * a
    s = torch.stack([1 + sign * nx * nx * a, sign * b, -sign * nx], 1)
    t = torch.stack([b, sign + ny * ny * a, -ny], 1)
    return s * x[:, None] + t * y[:, None] + n * z[:, None]


def sample_cosine(u: Tensor, n: Tensor) -> Tensor:
    """Cosine-weighted directions (N, 3) from random numbers (N, 2)."""
    r, phi = u[:, 0].sqrt(), 2 * torch.pi * u[:, 1]
    return to_world(n, r * phi.cos(), r * phi.sin(), (1 - u[:, 0]).sqrt())


def sample_mirrored(u: Tensor, n: Tensor, wo: Tensor, s: Tensor | float) -> tuple[Tensor, Tensor]:
    """Directions (N, 3) mirrored at GGX half vectors, and these half vectors; roughness is a number or (N,)."""
    a2 = s**4
    cos2 = (1 - u[:, 0]) / (u[:, 0] * (a2 - 1) + 1)
    cos, sin, phi = cos2.sqrt(), (1 - cos2).clamp_min(0).sqrt(), 2 * torch.pi * u[:, 1]
    h = to_world(n, sin * phi.cos(), sin * phi.sin(), cos)
    return torch.nn.functional.normalize(2 * dot(wo, h) * h - wo, dim=1), h


def g_one(cos: Tensor, s: Tensor | float) -> Tensor:
    """One side of G, divided by the cosine."""
    k = (s + 1) ** 2 / 8
    return 1 / (cos * (1 - k) + k)


def evaluate(n: Tensor, wi: Tensor, wo: Tensor, material: Tensor) -> tuple[Tensor, Tensor]:
    """Return f(i,o) (n.i), (N, 3), and the density (N, 1) of choosing i half by cosine, half by GGX."""
    base, s, m = material[:, :3], material[:, 3:4], material[:, 4:5]
    h = torch.nn.functional.normalize(wi + wo, dim=1)
    ni, no, nh = (dot(n, w).clamp_min(0) for w in (wi, wo, h))
    oh = dot(wo, h).clamp_min(1e-4)
    a2 = s**4
    # 1 - (n.h)^2 cancels near the lobe's centre: taken from the cross product
    d = a2 / (torch.pi * (nh * nh * a2 + torch.linalg.cross(n, h).square().sum(1, keepdim=True)).square())
    fc = (1 - oh).clamp_min(0) ** 5
    kd, ks = base * (1 - m), 0.04 * (1 - m) + base * m
    value = kd * (ni / torch.pi) + (ks * (1 - fc) + fc) * (d * g_one(ni, s) * g_one(no, s) * ni / 4)
    return value, 0.5 * (ni / torch.pi + d * nh / (4 * oh))


# --- emitters -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lamps:
    """Emitting triangles, picked uniformly.

    Attributes
    ----------
    of_triangle
        (T + 1,) int64 lamp number of every triangle, -1 for those that do not emit and for no triangle.
    triangle
        (E,) int64.
    radiance
        (E, 3).
    density
        (E, 1) of choosing a point on it, per square metre.
    corners
        (E, 3, 3) metres.
    normal
        (E, 3).
    """

    of_triangle: Tensor
    triangle: Tensor
    radiance: Tensor
    density: Tensor
    corners: Tensor
    normal: Tensor

    @classmethod
    def of(cls, mesh: Mesh, emitters: EmitterSet, device: str) -> "Lamps":
        """Lamps of a mesh; both of their sides shine."""
        number = np.full(len(mesh.triangles) + 1, -1)
        number[emitters.triangle] = np.arange(len(emitters.triangle))
        density = 1 / (len(emitters.triangle) * mesh.areas[emitters.triangle, None])
        arrays = (
            number,
            emitters.triangle.astype(np.int64),
            emitters.radiance,
            density.astype(np.float32),
            mesh.corners[emitters.triangle],
            mesh.normals[emitters.triangle],
        )
        return cls(*(torch.from_numpy(array).to(device) for array in arrays))


# --- the stages -----------------------------------------------------------------------------------


class PlainShader:
    """Estimates the shading integrals at points; see `fipt.render.tracer.Shader`.

    Parameters
    ----------
    rays
        The mesh to trace against.
    cache
        Radiance, and materials where paths go on.
    path
        None in round 0, where rays end in the cache at the first surface they meet; else how paths go on. Emitters
        are not sampled at the first hit, and rays that leave the mesh find nothing.
    lamps
        Of later rounds.
    network
        Asked for the material of every path vertex, (N, 3) points, if given. Its answer is dropped for that of the
        cache, so that runs with and without it follow the same paths and differ by its cost alone.
    """

    def __init__(
        self,
        rays: Rays,
        cache: DenseCache,
        path: PathSettings | None = None,
        lamps: Lamps | None = None,
        network: Callable[[Tensor], object] | None = None,
        seed: int = 0,
    ) -> None:
        self.rays, self.cache, self.path, self.lamps, self.network = rays, cache, path, lamps, network
        self.device = cache.values.device
        self.generator = torch.Generator(self.device).manual_seed(seed)

    @torch.no_grad()
    def shade(self, points: Points, levels: Sequence[float], counts: Sequence[int]) -> np.ndarray:
        """Estimate Ld, then Ls0 and Ls1 of every level; ``counts`` are the samples of the lobes, as `Shader.shade`."""
        p, n, wo = (torch.tensor(x, device=self.device) for x in (points.position, points.normal, points.wo))
        result = np.zeros((len(p), 1 + 2 * len(levels), 3), np.float32)
        for lobe, count in enumerate(counts):
            outputs = [lobe, lobe + len(levels)] if lobe else [0]
            size = max(BATCH // max(count, 1), 1)
            for start in range(0, len(p) if count else 0, size):
                part = slice(start, start + size)
                values = self._lobe(p[part], n[part], wo[part], levels[lobe - 1] if lobe else None, count)
                result[part, outputs] = values.cpu().numpy()
        return result

    def _lobe(self, p: Tensor, n: Tensor, wo: Tensor, s: float | None, count: int) -> Tensor:
        """(B, 1 or 2, 3): Ld, or Ls0 and Ls1 of roughness s, from ``count`` samples of that lobe."""
        p, n, wo = (x.repeat_interleave(count, 0) for x in (p, n, wo))
        u = self._random(len(p), 2)
        if s is None:
            wi = sample_cosine(u, n)
            weights = [torch.ones_like(u[:, :1])]
        else:
            wi, h = sample_mirrored(u, n, wo, s)
            ni, no, nh, oh = dot(n, wi).clamp_min(0), dot(n, wo).clamp_min(0), dot(n, h), dot(wo, h).clamp_min(0)
            weight = g_one(ni, s) * g_one(no, s) * ni * oh / nh.clamp_min(1e-6)
            fc = (1 - oh) ** 5
            weights = [weight * (1 - fc), weight * fc]
        light = self._from_cache(p, n, wi) if self.path is None else self._from_path(p, n, wi)
        return torch.stack([(w * light).view(-1, count, 3).mean(1) for w in weights], 1)

    def _from_cache(self, p: Tensor, n: Tensor, wi: Tensor) -> Tensor:
        """Radiance (N, 3) that one ray finds."""
        y, _, triangle = self.rays(p + n * self.rays.epsilon, wi)
        return self.cache(y)[:, :3] * (triangle >= 0)[:, None]

    def _from_path(self, p: Tensor, n: Tensor, wi: Tensor) -> Tensor:
        """Radiance (N, 3) that one path finds; ended paths leave the wavefront."""
        total = torch.zeros_like(p)
        lane = torch.arange(len(p), device=self.device)
        throughput = torch.ones_like(p)
        wo = material = pdf = None
        for depth in range(self.path.max_depth):
            if depth > 0:
                total[lane] += throughput * self._light_sample(p, n, wo, material)
                wi = self._next_direction(n, wo, material)
                value, pdf = evaluate(n, wi, wo, material)
                throughput = throughput * torch.where(pdf > 0, value / pdf, 0)
            y, n_y, triangle = self.rays(p + n * self.rays.epsilon, wi)
            number = self.lamps.of_triangle[triangle]
            lit = (number >= 0).nonzero()[:, 0]
            found = throughput[lit] * self.lamps.radiance[number[lit]]
            if depth > 0:
                distance2 = dot(y[lit] - p[lit], y[lit] - p[lit])
                p_light = self.lamps.density[number[lit]] * distance2 / dot(n_y[lit], wi[lit]).abs().clamp_min(1e-6)
                found *= pdf[lit] ** 2 / (pdf[lit] ** 2 + p_light**2)
            total[lane[lit]] += found

            go = ((triangle >= 0) & (number < 0) & (throughput.amax(1) > 0)).nonzero()[:, 0]
            p, n, wo, lane, throughput = y[go], n_y[go], -wi[go], lane[go], throughput[go]
            record = self._ask(p)
            last = depth + 1 >= self.path.max_depth
            ends = (record[:, 3] > 0) & ((record[:, 7] > self.path.cache_roughness) | last)
            at = ends.nonzero()[:, 0]
            total[lane[at]] += throughput[at] * record[at, :3]
            go = (~ends).nonzero()[:, 0]
            if last or len(go) == 0:
                break
            p, n, wo, lane, throughput, material = p[go], n[go], wo[go], lane[go], throughput[go], record[go, 4:]
            n = torch.where(dot(n, wo) < 0, -n, n)
        return total

    def _ask(self, p: Tensor) -> Tensor:
        """Records (N, 9) at path vertices, at the network's price where there is one."""
        if self.network is not None:
            for chunk in p.split(QUERY_CHUNK):
                self.network(chunk)
        return self.cache(p)

    def _light_sample(self, p: Tensor, n: Tensor, wo: Tensor, material: Tensor) -> Tensor:
        """What a light sample adds to the radiance (N, 3) from p, MIS weight included (power heuristic)."""
        lamps = self.lamps
        u = self._random(len(p), 3)
        e = (u[:, 0] * len(lamps.radiance)).long().clamp_max(len(lamps.radiance) - 1)
        root, v = u[:, 1:2].sqrt(), u[:, 2:3]
        a, b, c = lamps.corners[e].unbind(1)
        origin = p + n * self.rays.epsilon
        away = a * (1 - root) + b * (root * (1 - v)) + c * (root * v) - origin
        distance2 = dot(away, away)
        wl = away / distance2.sqrt()
        _, _, triangle = self.rays(origin, wl)
        cos = dot(lamps.normal[e], wl).abs()
        p_light = lamps.density[e] * distance2 / cos.clamp_min(1e-6)
        value, p_lobe = evaluate(n, wl, wo, material)
        visible = (triangle == lamps.triangle[e])[:, None] & (cos > 1e-6)
        mis = p_light**2 / (p_light**2 + p_lobe**2)
        return torch.where(visible, value * lamps.radiance[e] * (mis / p_light), 0)

    def _next_direction(self, n: Tensor, wo: Tensor, material: Tensor) -> Tensor:
        """Directions (N, 3), half from the cosine lobe, half from the material's GGX lobe."""
        u = self._random(len(n), 3)
        mirrored, _ = sample_mirrored(u[:, 1:], n, wo, material[:, 3])
        return torch.where(u[:, :1] < 0.5, sample_cosine(u[:, 1:], n), mirrored)

    def _random(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self.generator, device=self.device)
