"""The plain implementation of the benchmarks estimates the same integrals as the kernels."""

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS
from tests import scenes

COPIES = 600
COUNTS = [4] * (1 + len(ROUGHNESS_LEVELS))
SPOTS = [
    # position on the mesh, normal, direction to the viewer
    ((-0.8, -1.0, 0.5), (0.0, 1.0, 0.0), (0.4, 1.0, -0.3)),
    ((0.55, 0.1, -1.0), (0.0, 0.0, 1.0), (-0.6, 0.1, 0.8)),
]


@pytest.fixture(scope="module")
def room():
    return scenes.cornell()


@pytest.fixture(scope="module")
def voxels():
    """Radiance that changes from voxel to voxel; a third of them are unknown."""
    voxels = scenes.grid(np.random.default_rng(1).random((512, 3)), resolution=8)
    voxels["count"][::3] = 0
    return voxels


@pytest.fixture(scope="module")
def points():
    from fipt.render.points import Points

    position, normal, wo = (np.repeat(np.float32(column), COPIES, axis=0) for column in zip(*SPOTS, strict=True))
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    return Points(position, normal, wo, np.arange(len(wo), dtype=np.uint64))


def assert_agree(one, other, points):
    """Both shaders' means over the copies of a spot differ by no more than their noise.

    Three millionths are let pass: Ls1 of smooth levels is as small, and has tails that the copies do not show.
    """
    means, variances = [], []
    for shader in (one, other):
        values = shader.shade(points, ROUGHNESS_LEVELS, COUNTS).astype(np.float64).reshape(len(SPOTS), COPIES, -1)
        means.append(values.mean(axis=1))
        variances.append(values.var(axis=1) / COPIES)
    assert (means[0][:, :3] > 0.01).all()
    np.testing.assert_array_less(abs(means[0] - means[1]), 4.5 * np.sqrt(sum(variances)) + 1e-4 * means[0] + 3e-6)


def test_first_bounce_from_the_cache(backend, room, voxels, points):
    from benchmarks.plain import DenseCache, PlainShader, Rays
    from fipt.stages.shade.bake import cache_shader

    cache = DenseCache(voxels, voxels["count"] > 0, None, backend.torch_device)
    assert_agree(cache_shader(room.mesh, voxels, fill=False), PlainShader(Rays(room.mesh), cache), points)


@pytest.mark.parametrize("cache_roughness", [0.6, 1.0], ids=["ends in the cache", "goes on to the depth limit"])
def test_paths(backend, room, voxels, points, cache_roughness):
    from benchmarks.plain import DenseCache, Lamps, PlainShader, Rays
    from fipt.render.scene import RayScene
    from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    materials = scenes.sides(voxels, scenes.GLOSSY, scenes.DIFFUSE)
    emitters = EmitterSet(room.triangle, room.radiance)
    known = voxels["count"] > 0
    path = PathSettings(4, cache_roughness, light_at_first=False)
    surface = SurfaceCache(voxels, voxels["radiance"], known, materials)
    ours = Shader(RayScene(room.mesh), Triangles(room.mesh, emitters), surface, path)
    cache = DenseCache(voxels, known, materials, backend.torch_device)
    lamps = Lamps.of(room.mesh, emitters, backend.torch_device)
    asked = []
    plain = PlainShader(Rays(room.mesh), cache, path, lamps, network=lambda p: asked.append(len(p)))
    assert_agree(ours, plain, points)
    assert sum(asked) > len(points.position)


def test_the_rays_of_paths_are_those_that_are_traced(backend, room, voxels, points):
    """Paths of one bounce have a first ray, a ray to a lamp where it faces the surface, and at most one more."""
    import drjit as dr
    import mitsuba as mi

    from benchmarks.shading import bare_paths
    from fipt.render.scene import RayScene
    from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    counts = [8] + [0] * len(ROUGHNESS_LEVELS)
    materials = scenes.sides(voxels, scenes.DIFFUSE, scenes.DIFFUSE)
    surface = SurfaceCache(voxels, voxels["radiance"], np.zeros(len(voxels["key"]), bool), materials)
    lamps = Triangles(room.mesh, EmitterSet(room.triangle, room.radiance))
    shader = Shader(RayScene(room.mesh), lamps, surface, PathSettings(2, 1.0, light_at_first=False))
    before = shader.shade(points, ROUGHNESS_LEVELS, counts)
    scene, traced = shader.scene.scene, {}

    class Counting:
        """Counts what the shader's own rays meet."""

        def ray_intersect_preliminary(self, ray, coherent, active):
            found = scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
            self.add("closest", active)
            self.add("met", active & found.is_valid())
            return found

        def ray_test(self, ray, active):
            hidden = scene.ray_test(ray, active=active)
            self.add("shadow", active)
            self.add("hidden", active & hidden)
            return hidden

        def add(self, name, where):
            total = traced.setdefault(name, dr.opaque(mi.UInt32, 0, 1))
            dr.scatter_reduce(dr.ReduceOp.Add, total, 1, mi.UInt32(0), where)

    shader.scene.scene = Counting()
    shader.shade(points, ROUGHNESS_LEVELS, counts)
    shader.scene.scene = scene
    rays = {name: int(total[0]) for name, total in traced.items()}
    trace, paths = bare_paths(shader, points, counts)
    assert paths == 8 * len(points.position)
    assert paths < rays["closest"] <= 2 * paths
    assert 0 < rays["hidden"] < rays["shadow"] <= paths
    distance, hidden = trace()
    assert np.isfinite(distance.numpy()).sum() == rays["met"]
    assert hidden.numpy().sum() == rays["hidden"]
    assert shader.scene.scene is scene
    np.testing.assert_array_equal(shader.shade(points, ROUGHNESS_LEVELS, counts), before)
