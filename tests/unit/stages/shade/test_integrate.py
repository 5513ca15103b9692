"""Shading of a shard: sampling plan, denoising, storage."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS, SUB_POSITIONS
from fipt.errors import FiptError
from fipt.formats.files import shutil as files_shutil
from fipt.formats.manifests import read_manifest
from fipt.scene.shading import read_shading
from fipt.stages.shade.settings import BakeSettings
from tests import scenes

FEW = BakeSettings(diffuse_spp=5, specular_spp=3, smooth_spp=2)
LEVELS = len(ROUGHNESS_LEVELS)
COUNTS = [5, 2] + [3] * (LEVELS - 1)
SMOOTHEST = [1, 1 + LEVELS]
"""Ls0 and Ls1 of the smoothest level."""


@pytest.fixture
def integrate(backend):
    from fipt.stages.shade import integrate

    return integrate


class Constant:
    """A shader that answers 1, 2, ... in red, output after output, and notes what it was asked."""

    scene = SimpleNamespace(normals=np.float32([[0, 1, 0]]))

    def __init__(self):
        self.counts = []

    def shade(self, points, levels, counts, per_sample):
        assert tuple(levels) == ROUGHNESS_LEVELS
        self.counts.append(list(counts))
        result = np.zeros((len(points.position) // per_sample, SHADING_OUTPUTS, 3), np.float32)
        result[..., 0] = np.arange(1, 1 + SHADING_OUTPUTS)
        return result


def test_shared_sampling_is_one_run(integrate):
    assert integrate.sampling_plan(FEW) == [(COUNTS, list(range(SHADING_OUTPUTS)))]


def test_separate_sampling_is_a_run_for_each_lobe(integrate):
    plan = integrate.sampling_plan(FEW.model_copy(update={"sampling": "separate"}))
    counts = np.array([run for run, _ in plan])
    np.testing.assert_array_equal(counts, np.diag(COUNTS))
    assert [outputs for _, outputs in plan] == [[0]] + [[k, k + LEVELS] for k in range(1, 1 + LEVELS)]


@pytest.mark.parametrize("sampling", ["shared", "separate"])
def test_outputs_of_all_runs_come_together(integrate, sampling):
    points = SimpleNamespace(position=np.zeros((4, 3)))
    got = integrate.shade_chunk(Constant(), points, FEW.model_copy(update={"sampling": sampling}))
    np.testing.assert_array_equal(got[..., 0], np.tile(np.arange(1, 1 + SHADING_OUTPUTS), (4, 1)))


# --- denoising ------------------------------------------------------------------------------------


def image_samples(height=24, width=32):
    return scenes.samples_of(np.zeros((height * width, 3)), shapes=[(height, width)])


def test_denoising_keeps_a_constant(integrate):
    samples = image_samples()
    values = np.tile(np.linspace(0.2, 2, SHADING_OUTPUTS, dtype=np.float32)[:, None], (len(samples.position), 1, 3))
    change = np.abs(integrate.denoise_shading(values, samples, 0) / values - 1)
    assert change.mean() < 0.02
    inner = change.reshape(24, 32, -1)[6:-6, 6:-6]  # the network itself is wrong at an image's corners
    assert inner.max() < 0.02


def test_denoising_removes_noise(integrate, np_rng):
    samples = image_samples()
    values = np_rng.gamma(4.0, 0.25, (len(samples.position), SHADING_OUTPUTS, 3)).astype(np.float32)
    clean = integrate.denoise_shading(values, samples, 0)
    assert clean[:, 0].std() < 0.3 * values[:, 0].std()
    total, before = clean[:, 3] + clean[:, 3 + LEVELS], values[:, 3] + values[:, 3 + LEVELS]
    assert total.std() < 0.3 * before.std()
    np.testing.assert_array_equal(clean[:, SMOOTHEST], values[:, SMOOTHEST])  # the smoothest level


def test_both_parts_of_a_level_are_scaled_as_their_sum(integrate, monkeypatch, np_rng):
    values = np_rng.random((6, SHADING_OUTPUTS, 3)).astype(np.float32)
    values[0] = 0  # black stays black
    asked = []

    def double(images, samples, index, quality):
        asked.append(images)
        return 2 * images

    monkeypatch.setattr(integrate, "denoise_samples", double)
    got = integrate.denoise_shading(values, None, 0)
    kept = np.isin(np.arange(SHADING_OUTPUTS), SMOOTHEST)
    np.testing.assert_allclose(got[:, ~kept], 2 * values[:, ~kept], rtol=1e-5)
    np.testing.assert_array_equal(got[:, kept], values[:, kept])
    np.testing.assert_allclose(asked[0][:, 1:], values[:, 2 : 1 + LEVELS] + values[:, 2 + LEVELS :], rtol=1e-6)


def test_denoising_leaves_its_input(integrate):
    samples = image_samples()
    values = np.random.default_rng(0).random((len(samples.position), SHADING_OUTPUTS, 3)).astype(np.float32)
    before = values.copy()
    integrate.denoise_shading(values, samples, 0)
    np.testing.assert_array_equal(values, before)


# --- a shard --------------------------------------------------------------------------------------


@pytest.fixture
def shard():
    """Two views of 2 x 3 and 1 x 2 pixels and their dataset."""
    cameras = {name: scenes.look_at(name, (0, 2, 2), (0, 0, 0)) for name in "ab"}
    position = np.random.default_rng(0).random((9, 3))
    samples = scenes.samples_of(position, counts=[1, 2, 1, 0, 1, 1, 1, 2], views=("a", "b"), shapes=[(2, 3), (1, 2)])
    return SimpleNamespace(camera=cameras.get), samples


def test_a_shard_is_written_with_its_manifest(integrate, shard, tmp_path):
    shader = Constant()
    settings = FEW.model_copy(update={"denoise": False})
    stats = integrate.write_shading("bake", shader, *shard, settings, tmp_path / "bake" / "train-000")
    shading = read_shading(tmp_path / "bake" / "train-000")
    assert shading.shape == (9, SHADING_OUTPUTS, 3)
    np.testing.assert_allclose(shading[:][..., 0], np.tile(np.arange(1, 1 + SHADING_OUTPUTS), (9, 1)), rtol=0.05)
    manifest = read_manifest(tmp_path / "bake" / "train-000.manifest.json", "bake")
    assert list(manifest["files"]) == ["train-000/shading.npy"]
    assert manifest["settings"]["diffuse_spp"] == 5
    assert stats["bytes_per_pixel"] == pytest.approx(9 * 4 * (1 + LEVELS) / 8)
    assert shader.counts == [COUNTS] * 2


def test_values_too_large_and_below_zero_are_clipped(integrate, shard, tmp_path):
    class Extreme(Constant):
        def shade(self, *asked):
            values = super().shade(*asked)
            values[..., 1], values[..., 2] = 1e9, -1.0
            return values

    out = tmp_path / "train-000"
    integrate.write_shading("bake", Extreme(), *shard, FEW.model_copy(update={"denoise": False}), out)
    shading = read_shading(out)[:]
    assert np.isfinite(shading).all()
    assert shading.min() == 0
    assert 60000 < shading.max() < 2**17  # green may exceed the largest luminance


def test_a_full_disk_is_found_before_anything_is_traced(integrate, shard, tmp_path, monkeypatch):
    monkeypatch.setattr(files_shutil, "disk_usage", lambda place: SimpleNamespace(free=100))
    shader = Constant()
    with pytest.raises(FiptError, match="the bake shading needs"):
        integrate.write_shading("bake", shader, *shard, FEW, tmp_path / "new" / "train-000")
    assert not shader.counts
    assert not (tmp_path / "new").exists()


def test_a_bake_that_fails_leaves_the_old_one(integrate, shard, tmp_path):
    out, settings = tmp_path / "train-000", FEW.model_copy(update={"denoise": False})
    integrate.write_shading("bake", Constant(), *shard, settings, out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def fail(shading, folder):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        integrate.write_shading("bake", Constant(), *shard, settings, out, fail)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_bake_that_is_killed_before_its_manifest_leaves_none(integrate, shard, tmp_path, monkeypatch):
    """The manifest of the shading before would refuse the new one."""
    out, settings = tmp_path / "train-000", FEW.model_copy(update={"denoise": False})

    class Brighter(Constant):
        def shade(self, *asked):
            return 2 * super().shade(*asked)

    integrate.write_shading("bake", Constant(), *shard, settings, out)
    with monkeypatch.context() as patched:
        patched.setattr(integrate, "write_manifest", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            integrate.write_shading("bake", Brighter(), *shard, settings, out)
    assert read_shading(out)[:].max() > LEVELS * 2
    assert not (tmp_path / "train-000.manifest.json").exists()


# --- points ---------------------------------------------------------------------------------------


def test_points_of_a_view(backend, shard):
    from fipt.render.points import random_keys, view_points

    data, samples = shard
    camera = data.camera("b")
    points = view_points(samples, 1, camera, seed=3)
    np.testing.assert_array_equal(points.position, samples.position[6:])
    toward = camera.center - samples.position[6:]
    np.testing.assert_allclose(points.wo, toward / np.linalg.norm(toward, axis=1, keepdims=True), atol=1e-6)
    # pixel within the view and piece within the pixel, so that shards of other views give the same numbers
    np.testing.assert_array_equal(points.key, random_keys("b", np.array([0, 1, 1]), np.array([0, 0, 1]), 3))


def test_points_that_are_spread_over_samples(backend, shard):
    from fipt.render.points import spread_points, view_points

    data, samples = shard
    exact = np.random.default_rng(1).random(samples.sub.shape).astype(np.float32)
    samples.sub[:] = exact
    samples.sub_triangle[:] = [0, 1, 0, 1]
    normals = np.float32([[0, 1, 0], [0, 0, -1]])  # the camera is above and in front: the second one looks away
    middle = view_points(samples, 1, data.camera("b"), seed=3)
    points = spread_points(samples, 1, data.camera("b"), normals, per_sample=2, seed=3)
    np.testing.assert_array_equal(points.key, np.repeat(middle.key, 2))
    np.testing.assert_array_equal(points.normal, np.tile([[0, 1, 0], [0, 0, 1]], (3, 1)))
    expected = (samples.position[6:, None] + exact[6:, :2]).reshape(-1, 3)
    away = ((points.position - expected) * points.normal).sum(axis=1)
    assert (away >= 0).all()  # what was rounded does not hide a point behind its surface
    np.testing.assert_allclose(points.position, expected, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(points.wo, axis=1), 1, atol=1e-6)
    one = spread_points(samples, 1, data.camera("b"), normals, per_sample=1, seed=3)
    np.testing.assert_array_equal(one.position, samples.position[6:])


def test_all_points_share_the_paths_or_one_has_them(integrate):
    assert integrate.points_per_sample(BakeSettings()) == SUB_POSITIONS
    assert integrate.points_per_sample(FEW) == 1
    assert integrate.points_per_sample(BakeSettings(diffuse_spp=8, specular_spp=6, smooth_spp=4)) == 1


def test_chunks_come_back_in_order(backend, shard, monkeypatch):
    from fipt.render import points as module

    data, samples = shard
    monkeypatch.setattr(module, "CHUNK", 4)
    points, steps = module.view_points(samples, 0, data.camera("a"), 0), []
    got = module.shade_in_chunks(
        points, 1, lambda chunk, part: np.stack([chunk.position, points.position[part]], 1)[:, :1], steps.append, 10
    )
    np.testing.assert_array_equal(got[:, 0], points.position)
    assert steps == [40, 20]


def test_chunks_of_samples_of_two_points(backend, shard, monkeypatch):
    from fipt.render import points as module

    data, samples = shard
    monkeypatch.setattr(module, "CHUNK", 4)
    points, steps = module.spread_points(samples, 0, data.camera("a"), np.float32([[0, 1, 0]]), 2, 0), []
    got = module.shade_in_chunks(points, 1, lambda chunk, _: chunk.position[::2, None], steps.append, 10, per_sample=2)
    np.testing.assert_array_equal(got[:, 0], samples.position[:6])
    assert steps == [20, 20, 20]
