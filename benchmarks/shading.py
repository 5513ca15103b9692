"""Measurements of the shading stages: our kernels and the plain implementation in turns, on the same samples."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import torch

from benchmarks.fit_step import PAPER
from benchmarks.plain import DenseCache, Lamps, PlainShader, Rays, sample_cosine
from benchmarks.scene import Scene
from benchmarks.timing import added_memory, in_turns
from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.model.networks import Field, SceneBox
from fipt.render.points import Points
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.shading import Shading, save_shading
from fipt.stages.shade.bake import cache_shader
from fipt.stages.shade.integrate import sampling_plan
from fipt.stages.shade.refine import emitter_voxels, path_shader
from fipt.stages.shade.settings import BakeSettings, RefineSettings

OURS = sampling_plan(BakeSettings())[0][0]
"""Samples of the lobes by default: one set of directions for all outputs."""
SUPPLEMENT = [128] + [64] * len(ROUGHNESS_LEVELS)
"""Samples of the lobes in the paper's supplement, one lobe at a time."""
THREE_LOBES = [1] + [int(s in (0.412, 1.0)) for s in ROUGHNESS_LEVELS]
"""The diffuse, a middle and the roughest lobe: they stand for all where only the rate matters."""
_REFERENCE = [2048] + [1024] * len(ROUGHNESS_LEVELS)


def scaled(counts: Sequence[int], factor: float) -> list[int]:
    """Sample counts times a factor; at least one where there were any."""
    return [max(round(count * factor), 1) if count else 0 for count in counts]


class Contestants:
    """Shaders of both implementations for one scene, made once.

    Parameters
    ----------
    scene
        What to shade.
    network
        The material network that the plain implementation asks.
    device
        Of torch.
    """

    def __init__(self, scene: Scene, network: Field, device: str) -> None:
        voxels, known = scene.voxels, scene.voxels["count"] > 0
        path = PathSettings(RefineSettings().max_depth, RefineSettings().cache_roughness, light_at_first=False)
        lit_path = replace(path, light_at_first=True)
        rays = Rays(scene.mesh)
        seen = DenseCache(voxels, known, None, device)
        self.bake = cache_shader(scene.mesh, voxels, fill=True)
        self.plain_bake = PlainShader(rays, seen)
        self.published_bake = PlainShader(Rays(scene.mesh, together=False), seen)
        self.paths = path_shader(scene.mesh, voxels, scene.materials, scene.emitters, path)
        self.lit_paths = path_shader(scene.mesh, voxels, scene.materials, scene.emitters, lit_path)
        known = known & ~np.isin(voxels["key"], emitter_voxels(scene.mesh, voxels, scene.emitters.triangle))
        cache = DenseCache(voxels, known, scene.materials, device)
        lamps = Lamps.of(scene.mesh, scene.emitters, device)
        self.plain_paths = PlainShader(rays, cache, path, lamps)
        self.network_paths = PlainShader(rays, cache, path, lamps, network.brdf)


def paper_network(scene: Scene, device: str) -> Field:
    """An untrained field of the paper's sizes in plain torch: what it costs does not depend on what it knows."""
    box = SceneBox(tuple(scene.voxels["center"]), float(scene.voxels["side"]))
    return Field(PAPER, box, "torch").to(device)


Work = tuple[Callable[[], object], int]
"""A function and the samples that a call of it takes."""


def shade(shader: Shader | PlainShader, points: Points, counts: list[int]) -> Work:
    """Shading points with sample counts of the lobes."""
    return lambda: shader.shade(points, ROUGHNESS_LEVELS, counts), len(points.position) * sum(counts)


def bare_traversal(contestants: Contestants, points: Points, count: int) -> Work:
    """Tracing ``count`` diffuse rays a hit and nothing else: no implementation that traces them can be faster."""
    rays, device = contestants.plain_bake.rays, contestants.plain_bake.device
    p, n = (torch.tensor(x, device=device).repeat_interleave(count, 0) for x in (points.position, points.normal))
    wi = sample_cosine(torch.rand((len(p), 2), device=device), n)
    # copies in Dr.Jit's own memory
    origin, direction = (
        dr.copy(kind(x.T.contiguous())) for kind, x in ((mi.Point3f, p + n * rays.epsilon), (mi.Vector3f, wi))
    )
    dr.eval(origin, direction)

    def trace() -> None:
        found = rays.scene.ray_intersect_preliminary(mi.Ray3f(origin, direction), coherent=False)
        dr.eval(found.t, found.prim_index)
        dr.sync_thread()

    return trace, len(p)


class _Rays:
    """Rays that a kernel traces, in the order in which it does so."""

    def __init__(self, capacity: int) -> None:
        self.count = dr.opaque(mi.UInt32, 0, 1)
        self.columns = [dr.empty(mi.Float, capacity) for _ in range(7)]

    def keep(self, ray: "mi.Ray3f", active: "mi.Bool") -> None:
        """Note the rays of active lanes."""
        place = dr.scatter_inc(self.count, mi.UInt32(0), active)
        for column, value in zip(self.columns, (*ray.o, *ray.d, mi.Float(ray.maxt)), strict=True):
            dr.scatter(column, value, place, active)

    def kept(self) -> "mi.Ray3f":
        """The rays, alone."""
        lane = dr.arange(mi.UInt32, int(self.count[0]))
        ox, oy, oz, dx, dy, dz, end = (dr.gather(mi.Float, column, lane) for column in self.columns)
        ray = mi.Ray3f(mi.Point3f(ox, oy, oz), mi.Vector3f(dx, dy, dz), end, 0.0, [])
        dr.eval(ray)
        return ray


class _Recorder:
    """Stands in for the scene of a `fipt.render.scene.RayScene` and keeps the rays that are traced."""

    def __init__(self, scene: "mi.Scene", capacity: int) -> None:
        self.scene = scene
        self.closest, self.shadow = _Rays(capacity), _Rays(capacity)

    def ray_intersect_preliminary(self, ray: "mi.Ray3f", coherent: bool, active: "mi.Bool") -> object:
        self.closest.keep(ray, active)
        return self.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)

    def ray_test(self, ray: "mi.Ray3f", active: "mi.Bool") -> "mi.Bool":
        self.shadow.keep(ray, active)
        return self.scene.ray_test(ray, active=active)


def bare_paths(shader: Shader, points: Points, counts: list[int]) -> Work:
    """Tracing all rays of a shader's paths again and nothing else; samples are its paths."""
    paths, room = len(points.position) * sum(counts), shader.scene
    # a path has at most so many rays of each kind
    scene, recorder = room.scene, _Recorder(room.scene, shader.path.max_depth * paths)
    room.scene = recorder
    try:
        shader.shade(points, ROUGHNESS_LEVELS, counts)
    finally:
        room.scene = scene
    closest, shadow = recorder.closest.kept(), recorder.shadow.kept()

    def trace() -> "tuple[mi.Float, mi.Bool]":
        """Distances, infinite where nothing is met, and which of the shadow rays meet something."""
        found = scene.ray_intersect_preliminary(closest, coherent=False)
        distance, hidden = mi.Float(found.t), scene.ray_test(shadow)
        dr.eval(distance, found.prim_index, hidden)
        dr.sync_thread()
        return distance, hidden

    return trace, paths


def rates(works: dict[str, Work], repeats: int) -> dict[str, list[float]]:
    """Samples per second of every repeat."""
    times = in_turns({name: call for name, (call, _) in works.items()}, repeats, least=1.0)
    return {name: [works[name][1] / t for t in seconds] for name, seconds in times.items()}


# --- equal error ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Curve:
    """Error and time of one implementation at several sample counts.

    Attributes
    ----------
    samples
        (C,) per sample, all lobes together.
    error
        (C,) relative RMSE.
    seconds
        (C, R) of R repeats.
    """

    samples: np.ndarray
    error: np.ndarray
    seconds: np.ndarray

    def seconds_at(self, error: float) -> np.ndarray:
        """(R,) seconds to reach an error, interpolated between logarithms."""
        order = np.argsort(self.error)
        x = np.log(self.error[order])
        return np.exp([np.interp(np.log(error), x, column) for column in np.log(self.seconds[order]).T])


def error_curves(
    contestants: Contestants, points: Points, factors: dict[str, Sequence[float]], reference: float, repeats: int
) -> dict[str, Curve]:
    """Error against time of stage 1, ``ours`` and ``plain``, at multiples of their usual sample counts.

    The error is the root of the mean over all outputs of their squared error, each over its mean square, so that
    bright outputs do not outweigh dark ones.

    Parameters
    ----------
    reference
        Scales the sample counts of the converged reference.
    """
    independent = Points(points.position, points.normal, points.wo, points.key ^ np.uint64(0x5DEECE66D1234567))
    truth = contestants.bake.shade(independent, ROUGHNESS_LEVELS, scaled(_REFERENCE, reference))
    power = np.square(truth, dtype=np.float64).mean(axis=(0, 2))
    results: dict[str, np.ndarray] = {}

    def call(name: str, shader: Shader | PlainShader, counts: list[int]) -> None:
        results[name] = shader.shade(points, ROUGHNESS_LEVELS, counts)

    usual = {"ours": (contestants.bake, OURS), "plain": (contestants.plain_bake, SUPPLEMENT)}
    plan = {
        f"{who} {factor}": (shader, scaled(counts, factor))
        for who, (shader, counts) in usual.items()
        for factor in factors[who]
    }
    calls = {name: (lambda name=name, run=run: call(name, *run)) for name, run in plan.items()}
    times = in_turns(calls, repeats)
    errors = {
        name: float(np.sqrt((np.square(value - truth, dtype=np.float64).mean(axis=(0, 2)) / power).mean()))
        for name, value in results.items()
    }
    curves = {}
    for who in usual:
        own = [name for name in plan if name.startswith(who)]
        curves[who] = Curve(
            np.array([sum(plan[name][1]) for name in own]),
            np.array([errors[name] for name in own]),
            np.array([times[name] for name in own]),
        )
    return curves


# --- memory and disk ------------------------------------------------------------------------------


def memory(contestants: Contestants, points: Points) -> dict[str, float | None]:
    """Megabytes that shading the points adds to what scene and cache take, by stage and implementation."""
    full = scaled(THREE_LOBES, 64)  # fills the plain implementation's batches
    runs = {
        "bake ours": (contestants.bake, OURS),
        "bake plain": (contestants.plain_bake, full),
        "refine ours": (contestants.lit_paths, OURS),
        "refine plain": (contestants.plain_paths, full),
    }
    return {
        name: added_memory(lambda run=run: run[0].shade(points, ROUGHNESS_LEVELS, run[1])) for name, run in runs.items()
    }


def bytes_per_pixel(scene: Scene, contestants: Contestants) -> tuple[float, float]:
    """Shading of a view on disk: what the bake writes, and all outputs of one hit a pixel as float32."""
    shading = contestants.bake.shade(scene.view, ROUGHNESS_LEVELS, OURS)
    with tempfile.TemporaryDirectory() as folder:
        save_shading(Path(folder), Shading.of(shading))
        size = sum(file.stat().st_size for file in Path(folder).iterdir())
    return size / scene.pixels, SHADING_OUTPUTS * 3 * 4.0
