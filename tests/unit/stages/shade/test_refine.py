"""Parts of the refinement: which voxels the cache may answer for."""

import numpy as np

from fipt.stages.cache.build import voxel_keys
from tests import scenes


def test_voxels_of_emitters_are_not_read(backend):
    """A pane and its frame share voxels: light found there would count twice."""
    from fipt.render.surface import EmitterSet
    from fipt.render.tracer import PathSettings
    from fipt.stages.shade.refine import emitter_voxels, path_shader

    lit = scenes.two_planes((scenes.emitter_quad((0.1, 0.9), 0.9, (-0.4, 0.2)), (1, 1, 1)))
    voxels = scenes.grid(1.0, resolution=8, side=2.0)
    found = emitter_voxels(lit.mesh, voxels, lit.triangle)
    x, z = np.meshgrid(np.linspace(0.101, 0.899, 30), np.linspace(-0.399, 0.199, 30))
    on_emitter = np.float32(np.stack([x, np.full_like(x, 0.9), z], axis=-1).reshape(-1, 3))
    assert set(found) == set(voxel_keys(on_emitter, voxels["center"], 2.0, 8))

    voxels["count"][5] = 0  # no pixel told its radiance
    emitters = EmitterSet(lit.triangle, lit.radiance)
    records = scenes.sides(voxels, scenes.METAL, scenes.GLOSSY)
    shader = path_shader(lit.mesh, voxels, records, emitters, PathSettings(5, 0.6, True))
    stored = np.array(shader.cache.light).reshape(-1, 4)[:-1, 3]
    np.testing.assert_array_equal(np.flatnonzero(stored < 0), np.union1d(found, [5]))
    dark = path_shader(lit.mesh, voxels, records, None, PathSettings(5, 0.6, True))
    np.testing.assert_array_equal(np.flatnonzero(np.array(dark.cache.light).reshape(-1, 4)[:-1, 3] < 0), [5])
