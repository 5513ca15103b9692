"""Evidence grows with views, angle, agreement and highlights; nothing is sure of what nobody sees."""

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.formats.images import srgb_encode
from fipt.stages.fit import evidence as measured
from tests import scenes

LEVELS = len(ROUGHNESS_LEVELS)
EYES = {name: np.array([0.5, height, 0.5]) for name, height in (("a", 1.0), ("b", 2.0), ("c", 3.0))}
GRID = np.stack(np.meshgrid(np.arange(8), [0.0], np.arange(8)), axis=-1).reshape(-1, 3) / 8 + (1 / 16, 0, 1 / 16)
"""Points of a floor, one metre square; the box of all cases is that of its outer points."""


def floor(views="abc", **arrays):
    """Hits of the floor by every view, 64 pixels each."""
    position = np.tile(GRID, (len(views), 1))
    return scenes.samples_of(position, views=tuple(views), shapes=[(8, 8)] * len(views), **arrays)


def even(samples, albedo=0.5):
    """Even light without highlights, and what a matte floor shows of it."""
    shading = np.zeros((len(samples.position), SHADING_OUTPUTS, 3), np.float16)
    shading[:, 0] = 1
    return shading, np.full((len(shading), 3), albedo, np.float32)


def glossy(shading, rng):
    """Light with a bright spot here and there, in which smooth surfaces shine."""
    spots = rng.choice([0.0, 10.0], (len(shading), 1), p=[0.8, 0.2])
    for level, s in enumerate(ROUGHNESS_LEVELS):
        shading[:, 1 + level] = 2 + (spots - 2) * (1 - s)
    return shading


def judge(samples, shading, radiance, valid=None, eyes=EYES, clipped=None):
    image = (radiance, np.ones(len(radiance)) if valid is None else valid)
    clipped = np.zeros(len(radiance), bool) if clipped is None else clipped
    return measured.measure(scenes.observed([samples], [shading], [image], [clipped]), eyes, emitter_gain=1.5)


def mean(found, name="views"):
    return float(getattr(found, name).mean())


def test_more_views_are_surer():
    few, many = (judge(samples, *even(samples)) for samples in (floor("a"), floor("abc")))
    assert len(few.record) == len(many.record)  # the same surface
    assert 0 < mean(few) < mean(many) < 1


def test_the_formula_of_views():
    """One pixel a piece, seen from straight above by n views: sigma^2 = albedo^2 0.1^2 / n."""
    high = {name: np.array([0.5, 1e6, 0.5]) for name in "abc"}
    for views in ("a", "abc"):
        samples = floor(views, footprint=np.full(64 * len(views), 0.01, np.float32))
        found = judge(samples, *even(samples, 0.4), eyes=high)
        assert len(found.record) == 64
        sigma2 = (0.4 * 0.1) ** 2 / len(views)
        np.testing.assert_allclose(found.views, 1 / (1 + sigma2 / 0.05**2), rtol=0.01)


def test_grazing_views_are_less_evidence():
    low = {name: eye * (1, 0.02, 1) for name, eye in EYES.items()}
    samples = floor(footprint=np.full(192, 0.01, np.float32))
    assert mean(judge(samples, *even(samples), eyes=low)) < 0.5 * mean(judge(samples, *even(samples)))


def test_pixels_do_not_make_up_for_a_grazing_angle():
    """Four pixels of a piece, seen at 80 degrees by one view: it counts 0.17 like one pixel, not 0.7."""
    low = {"a": np.array([1e6, 1e6 / np.tan(np.radians(80)), 0.5])}
    one, four = (
        scenes.samples_of(
            np.repeat(GRID, count, axis=0), shapes=[(8, 8 * count)], footprint=np.full(64 * count, 0.01, np.float32)
        )
        for count in (1, 4)
    )
    few, many = (judge(samples, *even(samples), eyes=low) for samples in (one, four))
    np.testing.assert_allclose(many.views, few.views, rtol=0.01)


def test_views_that_disagree_are_less_evidence(np_rng):
    samples = floor()
    shading, radiance = even(samples)
    wrong = radiance * np_rng.uniform(0.3, 1.7, (len(radiance), 1)).astype(np.float32)
    assert mean(judge(samples, shading, wrong)) < 0.7 * mean(judge(samples, shading, radiance))


def test_only_varied_highlights_are_evidence(np_rng):
    samples = floor()
    shading, radiance = even(samples)
    assert mean(judge(samples, shading, radiance), "highlights") == 0
    same = shading.copy()
    same[:, 1 : 1 + LEVELS] = np.linspace(3, 1, LEVELS)[:, None]  # as much everywhere: it might be base colour
    assert mean(judge(samples, same, radiance), "highlights") < 2e-3
    assert mean(judge(samples, glossy(shading, np_rng), radiance), "highlights") > 0.3


def test_emitters_and_invalid_pixels_tell_nothing():
    samples = floor("ab")
    shading, radiance = even(samples)
    bright, valid = radiance.copy(), np.ones(len(radiance))
    bright[:64], valid[64:] = 50.0, 0
    found = judge(samples, shading, bright, valid)
    assert len(found.record)
    assert not found.views.any()
    assert not found.highlights.any()
    (shard,) = scenes.observed([samples], [shading], [(bright, valid)])
    known, emits = measured.of_pixels(shard, found, 1.5)
    assert not known.any()
    np.testing.assert_array_equal(emits, np.arange(128) < 64)


def test_clipped_pixels_tell_nothing():
    samples = floor()
    shading, radiance = even(samples)
    clipped = np.arange(len(radiance)) < 64
    bound = np.where(clipped[:, None], 0.1 * radiance, radiance)
    found = judge(samples, shading, bound, clipped=clipped)
    np.testing.assert_array_equal(found.views, judge(samples, shading, radiance, valid=1.0 * ~clipped).views)


def test_shards_do_not_matter(np_rng):
    samples = floor()
    shading, radiance = even(samples)
    shading = glossy(shading, np_rng)
    radiance *= np_rng.uniform(0.5, 1.5, (192, 1)).astype(np.float32)
    whole = judge(samples, shading, radiance)
    parts = [slice(64 * k, 64 * (k + 1)) for k in range(3)]
    split = measured.measure(
        scenes.observed(
            [floor(view) for view in "abc"],
            [shading[part] for part in parts],
            [(radiance[part], np.ones(64)) for part in parts],
        ),
        EYES,
        1.5,
    )
    for name in ("record", "views", "highlights"):
        np.testing.assert_array_equal(getattr(split, name), getattr(whole, name))


def test_voxels_follow_the_pixels():
    coarse = floor("a", footprint=np.full(64, 0.2, np.float32))
    assert judge(coarse, *even(coarse)).resolution == 8
    fine = floor("a", footprint=np.full(64, 1e-4, np.float32))
    assert judge(fine, *even(fine)).resolution == 96


def test_surface_is_found_by_voxel_and_facing():
    samples = floor()
    found = judge(samples, *even(samples))
    up, down = np.tile([0.0, 1, 0], (64, 1)), np.tile([0.0, -1, 0], (64, 1))
    at = found.at(GRID, up, found.combined)
    assert ((at > 0) & (at < 1)).all()
    assert not found.at(GRID, down, found.combined).any()
    assert not found.at(GRID + np.array([0, 0.45, 0]), up, found.combined).any()


def test_half_of_it_needs_highlights():
    views, highlights = np.float32([0, 0.8, 0.8, 1]), np.float32([1, 0, 1, 1])
    known = measured.PhotoEvidence(np.zeros(3), 1.0, 8, np.arange(4), views, highlights)
    np.testing.assert_allclose(known.combined, [0, 0.4, 0.8, 1])


def test_evidence_falls_with_the_error_of_the_base_colour(np_rng):
    """Noisy shading, known albedo: the error of the mean over views falls from the least to the most sure pieces."""
    views = "abcdefghi"
    count = 64 * len(views)
    samples = floor(views, footprint=np.full(count, 0.01, np.float32))
    noise = np.tile(np_rng.uniform(0.02, 0.8, 64), len(views))
    shading, radiance = even(samples)
    radiance *= np.exp(noise * np_rng.standard_normal(count))[:, None].astype(np.float32)
    found = judge(samples, shading, radiance, eyes=dict.fromkeys(views, EYES["a"]))
    error = np.abs(srgb_encode(radiance[:, 0].reshape(-1, 64).mean(axis=0)) - srgb_encode(np.float32(0.5)))
    order = np.argsort(found.at(GRID, np.tile([0.0, 1, 0], (64, 1)), found.views))
    assert error[order[:20]].mean() > 2 * error[order[-20:]].mean()


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_dark_images_give_numbers(channel):
    samples = floor()
    shading, radiance = even(samples)
    radiance[:, channel] = 0
    for image, light in ((radiance, shading), (0 * radiance, shading), (0 * radiance, 0 * shading)):
        found = judge(samples, light, image)
        assert np.isfinite(found.views).all()
        assert np.isfinite(found.highlights).all()
