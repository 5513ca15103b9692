"""Predicted errors after the fit: each cause of error raises them, and they are about as large as the errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.model.reflectance import Brdf
from fipt.stages.fit import uncertainty
from fipt.stages.fit.material_posterior import MaterialPosterior
from tests import scenes

GRID = np.stack(np.meshgrid(np.arange(8), [0.0], np.arange(8)), axis=-1).reshape(-1, 3) / 8 + (1 / 16, 0, 1 / 16)
"""Points of a floor, one metre square."""
UP = np.tile([0.0, 1, 0], (64, 1))
KD = 0.5


class Grey:
    """Fitted networks that say the same everywhere."""

    settings = SimpleNamespace(footprint=0.5)

    def __init__(self, metallic=0.0):
        self._metallic = metallic

    def place(self, points, normals):
        assert normals.shape == points.shape
        np.testing.assert_array_equal(normals.sum(axis=1), 1)  # along an axis: as the samples have them
        return points

    def query(self, points, footprint):
        count = len(points)
        assert footprint.shape == (count,)
        rough, metal = np.full(count, 0.5, np.float32), np.full(count, self._metallic, np.float32)
        return Brdf(np.full((count, 3), KD, np.float32), rough, metal)


class Halves(Grey):
    """Two colours that meet in the middle of the floor."""

    def query(self, points, footprint):
        brdf = super().query(points, footprint)
        factor = np.where(points[:, :1] < 0.5, 1.6, 0.4).astype(np.float32)
        return Brdf(brdf.base_color * factor, brdf.roughness, brdf.metallic)


def materials(metal=0.0, segments=2):
    """Each segment is metal with this probability, and of roughness 0.25 or 0.75."""
    chance = np.array([[1 - metal] * 2, [metal] * 2])[:, :, None] / 2
    return MaterialPosterior(np.array([0.25, 0.75]), np.repeat(chance, segments, axis=2))


def floor(views="abc", **arrays):
    position = np.tile(GRID, (len(views), 1))
    shapes = [(8, 8)] * len(views)
    return scenes.samples_of(position, views=tuple(views), shapes=shapes, **arrays)


def shaded(samples, light=1.0, mirrored=0.0):
    shading = np.zeros((len(samples.position), SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = light
    shading[:, 1 : 1 + len(ROUGHNESS_LEVELS)] = mirrored
    return shading


def predicted(
    samples, factor=1.0, field=None, known=None, uniform=0.0, earlier=None, clipped=None, gain=1.5, mirrored=0.0
):
    """Of a grey floor whose pixels are ``factor`` (P,) times what the fit says."""
    count = len(samples.position)
    radiance = np.broadcast_to(KD * np.float32(np.reshape(factor, (-1, 1))), (count, 3)).astype(np.float32)
    images = [(radiance, np.ones(count))]
    pixels = scenes.training_pixels([samples], [shaded(samples, mirrored=mirrored)], images, clipped=clipped)
    before = [] if earlier is None else [shaded(samples, earlier)]
    return uncertainty.predict(field or Grey(), pixels, known or materials(), np.full(2, uniform), gain, before)


def test_a_perfect_fit_is_sure():
    found = predicted(floor(), earlier=1.0)
    assert found.known.all()
    assert found.kd_error.max() < 1e-3
    np.testing.assert_allclose(found.roughness_error, 0.25)
    np.testing.assert_allclose(found.metallic_error, 0)
    assert found.combined.min() == 1
    assert found.at(GRID, UP, found.combined).all()
    assert not found.at(GRID, -UP, found.combined).any()


def test_residuals_are_errors_of_kd(np_rng):
    """Twice the residual is about twice the error, up to that of a colour of which nothing is known."""
    sign = np_rng.choice([-1, 1], 192)
    errors = [float(predicted(floor(), 1 + size * sign, earlier=1.0).kd_error.mean()) for size in (0.02, 0.04, 1.0)]
    assert errors[1] == pytest.approx(2 * errors[0], rel=0.05)
    assert 0.01 < errors[0] < 0.05
    assert errors[2] < 12**-0.5


def test_light_that_changed_since_round_0_is_doubtful():
    same, other = predicted(floor(), earlier=1.0), predicted(floor(), earlier=0.8)
    assert other.kd_error.min() > 5 * same.kd_error.max()
    unchecked = predicted(floor())  # round 0 itself
    assert same.kd_error.max() < unchecked.kd_error.min() < other.kd_error.min()


def test_a_part_of_one_colour_averages_its_pieces(np_rng):
    factor = 1 + 0.2 * np_rng.choice([-1, 1], 192)
    assert predicted(floor(), factor, uniform=8.0).kd_error.mean() < predicted(floor(), factor).kd_error.mean()


def test_what_may_be_metal_has_an_error_of_its_whole_colour():
    found = predicted(floor(), known=materials(metal=0.5), earlier=1.0)
    assert found.kd_error.min() > 0.15
    np.testing.assert_allclose(found.metallic_error, 0.5)
    metal = {"field": Grey(metallic=1.0), "known": materials(metal=1.0), "gain": 1e9, "earlier": 1.0}
    taken = predicted(floor(), **metal, mirrored=1.0)
    np.testing.assert_allclose(taken.metallic_error, 0)
    assert taken.kd_error.max() < 1e-3
    unexplained = predicted(floor(), **metal, mirrored=0.7)  # no residual in kd, which is 0
    assert unexplained.kd_error.min() > 0.15


def test_outlines_beside_where_the_mesh_has_them_are_doubtful():
    """A view in four shows the border between two colours a pixel further on, another a pixel before it.

    A part of one colour averages what is left of its photographs; which pixels show it, it does not.
    """
    straight = [np.where(GRID[:, 0] < 0.5, 1.6, 0.4)] * 4
    shifted = [np.where(GRID[:, 0] < 0.5 + away / 8, 1.6, 0.4) for away in (0, 0, 1, -1)]
    sure, doubtful = (
        predicted(floor("abcd"), np.concatenate(factor), Halves(), uniform=8.0, earlier=1.0)
        for factor in (straight, shifted)
    )
    assert sure.kd_error.max() < 1e-3
    error = doubtful.at(GRID, UP, doubtful.kd_error)
    away = np.abs(GRID[:, 0] - 0.5)
    assert error[away < 0.1].min() > 0.05
    assert error[away > 0.3].max() < 1e-3


def test_a_mask_is_no_outline():
    """The first column of every view is masked, and black then, as `Dataset.image` reads it."""
    masked = np.tile(GRID[:, 0] < 0.1, 4)
    radiance = np.full((len(masked), 3), KD, np.float32)
    radiance[masked] = 0
    samples = floor("abcd")
    pixels = scenes.training_pixels([samples], [shaded(samples)], [(radiance, (~masked).astype(np.float32))])
    found = uncertainty.predict(Grey(), pixels, materials(), np.full(2, 8.0), 1.5, [shaded(samples, 1.0)])
    assert found.at(GRID, UP, found.kd_error)[GRID[:, 0] > 0.1].max() < 1e-3


def test_surface_that_only_shares_pixels_is_doubtful():
    """Every pixel shows the floor by a tenth, and for the rest a wall behind it."""
    wall = np.stack([GRID[:, 0], 0.5 + GRID[:, 2], 0 * GRID[:, 0]], axis=1)
    position = np.stack([GRID, wall], axis=1).reshape(-1, 3)
    normal = np.tile(np.float32([[0, 1, 0], [0, 0, 1]]), (64, 1))
    weight = np.tile(np.float32([0.1, 0.9]), 64)
    samples = scenes.samples_of(position, weight=1.0, counts=np.full(64, 2), shapes=[(8, 8)], normal=normal)
    samples.weight[:] = weight
    images = [(np.full((64, 3), KD, np.float32), np.ones(64))]
    pixels = scenes.training_pixels([samples], [shaded(samples)], images)
    found = uncertainty.predict(Grey(), pixels, materials(), np.zeros(2), 1.5, [shaded(samples)])
    floor_error, wall_error = (found.at(p, n, found.kd_error) for p, n in ((GRID, UP), (wall, normal[1::2])))
    assert floor_error.min() > 5 * wall_error.max()


def test_clipped_pixels_and_emitters_tell_nothing():
    samples = floor("ab")
    factor = np.where(np.arange(128) < 64, 100.0, 1.0)
    clipped = np.arange(128) >= 64
    found = predicted(samples, factor, clipped=[clipped])
    assert not found.known.any()
    assert not found.combined.any()


def test_shards_do_not_matter(np_rng):
    factor = (1 + 0.1 * np_rng.standard_normal(192)).astype(np.float32)
    radiance = np.repeat(KD * factor[:, None], 3, axis=1).astype(np.float32)
    parts = [slice(64 * k, 64 * (k + 1)) for k in range(3)]
    shards = [floor(view) for view in "abc"]
    images = [(radiance[part], np.ones(64)) for part in parts]
    pixels = scenes.training_pixels(shards, [shaded(shard) for shard in shards], images)
    split = uncertainty.predict(Grey(), pixels, materials(), np.zeros(2), 1.5)
    whole = predicted(floor(), factor)
    np.testing.assert_array_equal(split.record, whole.record)
    np.testing.assert_allclose(split.kd_error, whole.kd_error, rtol=1e-6)


def test_pieces_that_are_not_asked_are_like_their_part(np_rng, monkeypatch):
    factor = (1 + 0.1 * np_rng.standard_normal(192)).astype(np.float32)
    whole = predicted(floor(), factor)
    monkeypatch.setattr(uncertainty, "_MOST_SAMPLES", 48)
    few = predicted(floor(), factor)
    np.testing.assert_array_equal(few.record, whole.record)
    assert few.known.all()
    assert few.kd_error.mean() == pytest.approx(whole.kd_error.mean(), rel=0.3)
