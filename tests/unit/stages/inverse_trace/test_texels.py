"""Textures through the path tracer: gradients against finite differences; what differs within a part is found."""

import copy

import numpy as np
import pytest

from fipt.render.replay import PathBatch, ReplayScene
from fipt.stages.inverse_trace.optimise import optimise
from fipt.stages.inverse_trace.rays import TrainingPixels
from fipt.stages.inverse_trace.settings import InverseTraceSettings
from fipt.stages.inverse_trace.texels import SurfaceTexels, TextureOptimiser
from tests.scenes import cornell
from tests.unit.stages.inverse_trace.test_optimise import TRUE, Cameras, groups  # noqa: F401 - a fixture


@pytest.fixture(scope="module")
def texels(groups):  # noqa: F811
    return SurfaceTexels.of(cornell().mesh, groups, 8.0)


@pytest.fixture(scope="module")
def scene(groups, texels, backend):  # noqa: F811
    return ReplayScene(cornell().mesh, groups, 4, texels.rows)


@pytest.fixture(scope="module")
def upper(texels):
    """Texels of the first two groups in the upper half of the room."""
    return (texels.group < 2) & (texels.place[:, 1] > 0)


def rows_of(texels, upper, bright=0.5):
    values = {name: value[texels.group] if name != "emission" else value for name, value in copy.deepcopy(TRUE).items()}
    values["base_color"][upper] = bright
    return values


def test_texels_lie_on_their_parts(texels, groups):  # noqa: F811
    assert set(texels.group) == set(groups)
    # 64 texels a square metre, and some along the edges of charts
    assert 1.0 < len(texels.place) / (64 * cornell().mesh.areas.sum()) < 2.0
    assert np.abs(texels.roughen @ np.ones(len(texels.place))).max() < 1e-9
    assert np.abs(texels.roughen @ (texels.group == 2)).max() == 0  # no neighbours across parts
    values = {"base_color": texels.place, "roughness": texels.place[:, 0], "metallic": texels.place[:, 1]}
    found = texels.materials(3, values).query(
        texels.place + np.float32(0.005), triangle=np.zeros(len(texels.place), int)
    )
    assert np.abs(found.base_color - texels.place).max() < 0.15


@pytest.mark.parametrize(("name", "step"), [("base_color", 0.05), ("roughness", 0.05), ("metallic", 0.05)])
def test_gradients_of_texels_are_those_of_finite_differences(scene, texels, upper, name, step):
    direction = np.random.default_rng(0).normal(size=(1 << 14, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rays = PathBatch(np.tile(np.float32([0.1, 0, 0.3]), (len(direction), 1)), direction.astype(np.float32))
    values, sums = rows_of(texels, upper), []
    before = values[name].copy()
    for change in (step, -step):
        values[name] = before + change * upper.reshape(-1, *[1] * (before.ndim - 1))
        scene.assign(values)
        sums.append(scene.radiance(rays, 0).sum(axis=1).mean())
    values[name] = before
    scene.assign(values)
    found = scene.gradient(rays, 7, np.full((len(direction), 3), 1 / len(direction), np.float32))[name]
    assert found.shape == before.shape
    assert found[upper].sum() == pytest.approx((sums[0] - sums[1]) / (2 * step), rel=0.1, abs=0.01)


def test_what_differs_within_a_part_is_found(scene, texels, upper):
    row, column = (np.tile(each, 6) for each in np.divmod(np.arange(16 * 12), 16))
    view = np.repeat(np.arange(6), 16 * 12)
    none = np.zeros(len(view), bool)
    blank = TrainingPixels(Cameras(), [str(k) for k in range(6)], view, row, column, np.zeros((len(view), 3)), none)
    true = rows_of(texels, upper, bright=0.9)
    scene.assign(true)
    radiance = scene.radiance(blank.rays(np.arange(len(view)), 64, np.random.default_rng(1)), 3)
    radiance = radiance.reshape(-1, 64, 3).mean(axis=1)
    pixels = TrainingPixels(Cameras(), blank.views, view, row, column, radiance, none)
    settings = InverseTraceSettings(steps=80, pixels=256, spp=2, max_depth=4, emission_rate=0.4, learning_rate=0.1)

    def made(count, level):
        return TextureOptimiser(texels, count, level, settings.smoothness)

    found = optimise(scene, pixels, np.array([0.3, 0.2, 0.2, 5.0, 60.0]), settings, made)
    assert found.emits[:4].tolist() == [False, False, False, True]
    base = found.values()["base_color"].mean(axis=1)
    for part in (0, 1):  # 0.3 and 0.43 brighter in truth
        own = texels.group == part
        assert base[own & upper].mean() > base[own & ~upper].mean() + 0.1
