"""Arrays on their way into kernels."""

import numpy as np
import pytest

from tests import scenes


def placed(values, offset):
    """A copy of an array that starts ``offset`` bytes after a multiple of 128."""
    memory = np.empty(values.nbytes + 256, np.uint8)
    start = -memory.ctypes.data % 128 + offset
    copy = memory[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[:] = values
    return copy


@pytest.mark.parametrize("dtype", [np.float32, np.uint64])
def test_lanes_keep_their_values(backend, np_rng, dtype):
    import mitsuba as mi

    from fipt.render.scene import lanes

    values = np_rng.integers(0, 1 << 20, 129).astype(dtype)
    kind = {np.float32: mi.Float, np.uint64: mi.UInt64}[dtype]
    np.testing.assert_array_equal(lanes(values[::2], kind).numpy(), values[::2])


def test_where_numpy_puts_arrays_compiles_nothing_again(backend):
    import drjit as dr

    from fipt.render.points import Points
    from fipt.render.scene import RayScene
    from fipt.render.surface import SurfaceCache, Triangles
    from fipt.render.tracer import Shader

    mesh, voxels, count = scenes.box((-1, -1, -1), (1, 1, 1)), scenes.grid(), 129
    cache = SurfaceCache(voxels, voxels["radiance"], np.ones(len(voxels["key"]), bool))
    shader = Shader(RayScene(mesh), Triangles(mesh, None), cache, None)
    up = np.tile(np.float32([0, 0, 1]), (count, 1))
    arrays = np.zeros((count, 3), np.float32), up, up, np.arange(count, dtype=np.uint64)
    roughness = np.full(count, 0.5, np.float32)

    def kernels(offset):
        """Shading of the same points, and names of the kernels that ran."""
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            points = Points(*(placed(array, offset) for array in arrays))
            shading = shader.shade(points, [placed(roughness, offset)], [4, 4])
            return shading, {entry["hash"] for entry in dr.kernel_history([dr.KernelType.JIT])}

    (one, first), *others = (kernels(offset) for offset in (0, 8, 16, 64))
    for shading, names in others:
        np.testing.assert_array_equal(shading, one)
        assert names == first
